"""Hashes of whole files, by which a dataset recognises them. Files with much data behind their records, among them sparse ones of
terabytes, take little reading. Progress is reported for a long hash."""
import os
import re

import e2e
from e2e import Daemon, Folder, expect

try:
    from acut_wire import Client, pb
except ImportError as e:
    e2e.skip("python3-xxhash and python3-protobuf are needed: %s" % e)

SPARSE = 8 << 40


def survey(base, name="survey.las"):
    path = os.path.join(base, name)
    e2e.run([e2e.SYNTH, "--points", "5000", "--seed", "1", path]).ok()
    return path


def longer(path, size):
    try:
        os.truncate(path, size)
    except OSError as e:
        print("     skipped: no file of %d bytes here (%s)" % (size, e.strerror))
        return False
    return True


def bytes_read(d):
    with open("/proc/%d/io" % d.process.pid) as f:
        return int(re.search(r"rchar: (\d+)", f.read()).group(1))


def little_is_read(d, *args):
    """Runs the command; the daemon must read less than 16 MiB of its input."""
    before = bytes_read(d)
    got = d.ctl(*args)
    expect(bytes_read(d) - before < 16 << 20, "%s: %d bytes read" % (args, bytes_read(d) - before))
    return got


def sparse():
    with Folder() as base, Daemon(base) as d:
        path, out = survey(base), os.path.join(base, "o.ply")
        end = os.path.getsize(path)
        if not longer(path, SPARSE):
            return
        for more in ([], ["--checksum"], ["--replace"]):
            got = little_is_read(d, "push", "s", path, *more)
            expect(got.status == 1 and "8.0 TB behind its records belong to nothing" in got.err, got.err)
            expect("byte %d" % end in got.err and "truncate -s %d" % end in got.err, got.err)
        # without a sum there is nothing that would read it
        got = little_is_read(d, "mesh", "--json", path, "-o", out).ok().json()
        expect(got["points"] == 5000 and any("behind the last point" in w for w in got["warnings"]), got)
        little_is_read(d, "info", path).ok()
        # the hint
        os.truncate(path, end)
        d.ctl("push", "s", path).ok()
        # of text all is records: the first line that is none ends it
        text = os.path.join(base, "sparse.xyz")
        with open(text, "w") as f:
            f.write("1 2 3\n4 5 6\n7 8 1\n")
        longer(text, SPARSE)
        for command in (["push", "t", text], ["mesh", text, "-o", out]):
            got = little_is_read(d, *command)
            expect(got.status == 1 and "line 4" in got.err, got.err)
        # records that a header claims are its own
        if e2e.data_dir():
            for name in ("las12_pdrf0_utm10.laz", "las10_pdrf0_ft_pointwise.laz", "las14_pdrf7_1065.copc.laz"):
                copy = os.path.join(base, name)
                with open(os.path.join(e2e.data_dir(), "lidar", name), "rb") as f, open(copy, "wb") as g:
                    g.write(f.read())
                longer(copy, SPARSE)
                for more in ([], ["--checksum"]):
                    got = little_is_read(d, "push", "z", copy, *more)
                    expect(got.status == 1 and "belong to nothing" in got.err, got.err)


def a_sum_is_told_of():
    """Less than the bound is read, and the file is recognised again. The push reports its progress meanwhile, also before the
    file is recognised."""
    with Folder() as base:
        gate = e2e.Gate(base)
        with Daemon(base, env=gate.env) as d:
            path = survey(base)
            os.truncate(path, 200 << 20)
            for probe in (False, True):
                with Client(d.socket) as c, open(path, "rb") as f:
                    begun = c.ask("push_begin", pb.PushBegin(dataset="s"))
                    named = pb.Probe(push=begun.push, name="survey.las", path=path.encode(), checksum=probe)
                    if not probe:
                        c.ask("probe", named, f.fileno())
                        c.ask("push_plan", pb.PushPlan(push=begun.push))
                    gate.close("pread", "survey.las", 1000) # of 3200 pieces
                    if probe:
                        request = c.send("probe", named, f.fileno())
                    else:
                        request = c.send("file", pb.File(push=begun.push, name="survey.las"), f.fileno())
                    gate.wait()
                    told = e2e.until(lambda: c.ping() and [p for p in c.progress if p.phase == "hash"], "the sum is not told of")[-1]
                    expect(told.points < told.points_total == 200 << 20, told)
                    gate.open()
                    got, _ = c.answer(request, "probed" if probe else "file_done")
                    expect(got.points == 5000 and (not probe or got.known), got)
                    if not probe:
                        c.ask("push_commit", pb.PushCommit(push=begun.push))
                    else:
                        c.ask("push_abort", pb.PushAbort(push=begun.push))


if __name__ == "__main__":
    e2e.main(sparse, a_sum_is_told_of)
