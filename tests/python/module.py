"""Shared by the tests of the Python module."""
import sys

import e2e

SMALL = {"memory": "24M", "threads": 2}
lost = []  # exceptions that ctypes or the collector would only print
sys.unraisablehook = lambda u: lost.append("%r in %r" % (u.exc_value, u.object))


def synth(path, points=20000, seed=1, *options):
    e2e.run([e2e.SYNTH, "--points", points, "--seed", seed, *options, path]).ok()
    return path


def raises(kind, call, *args, **kw):
    try:
        call(*args, **kw)
    except kind as e:
        return e
    raise e2e.Fault("%s did not come of %s %r %r" % (kind.__name__, call, args, kw))
