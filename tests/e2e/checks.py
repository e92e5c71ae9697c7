"""Checks that do not end a test: a line for each that fails, and the exit status. For tests of one long story; others use e2e.expect."""
import sys
import time

failed = passed = 0


def check(what, cond, detail=""):
    global failed, passed
    passed, failed = passed + bool(cond), failed + (not cond)
    if not cond:
        print("FAIL", what, detail, flush=True)


def asked(*parts):
    """Those that the command names, or all; prints what time each took."""
    for part in parts:
        if len(sys.argv) < 2 or part.__name__ in sys.argv[1:]:
            begun = time.time()
            yield part
            print("%s: %.1f s" % (part.__name__, time.time() - begun), flush=True)


def end():
    print("%d passed, %d failed" % (passed, failed))
    sys.exit(1 if failed else 0)
