"""Inputs from pipes: the same mesh as from a file, never a part that is taken for the whole, and nobody else has to wait."""
import gzip
import json
import os
import shutil
import signal
import subprocess
import time

import e2e
from e2e import expect
from survey import las


def survey(base, points=120000, *options):
    path = os.path.join(base, "s%d.las" % points)
    e2e.run([e2e.SYNTH, "--points", points, *options, path]).ok()
    return path


def feed(d, pieces, *args, pause=0.0):
    """acutctl with its standard input fed in pieces: exit status, output, errors."""
    p = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, *args], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    for piece in pieces:
        try:
            p.stdin.write(piece)
            p.stdin.flush()
        except BrokenPipeError:
            break
        time.sleep(pause)
    try:
        p.stdin.close()
    except BrokenPipeError:
        pass
    p.stdin = None
    out, err = p.communicate(timeout=e2e.PATIENCE)
    return p.returncode, out.decode(), err.decode()


def digest(d, *args):
    got = d.ctl("mesh", "--json", *args).ok().json()
    return got["digest"], got["vertex_digest"], got["points"]


def las_forwards():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out = survey(base), os.path.join(base, "m.ply")
        want = digest(d, "-o", out, path)
        data = open(path, "rb").read()
        one, odd = [data], [data[:3], data[3:226], data[226:5000], data[5000:1000003], data[1000003:]]
        for pieces in (one, odd, [data + b"\0" * 100000]):
            code, text, err = feed(d, pieces, "mesh", "-", "--input-format", "las", "--json", "-o", out, pause=0.05)
            expect(code == 0, err)
            got = json.loads(text)
            expect((got["digest"], got["vertex_digest"], got["points"]) == want, text)
        # Its first bytes say what it is, however they come; those of text do not, nor do those of one among several.
        code, text, err = feed(d, [data[:1], data[1:3], data[3:]], "mesh", "-", "--json", "-o", out, pause=0.05)
        expect(code == 0 and json.loads(text)["digest"] == want[0], "without --input-format: %d %s" % (code, err))
        for pieces, words in (([b"1 2 3\n"], ()), ([b"LAS"], ()), ([b""], ()), ([data], (path,))):
            code, _, err = feed(d, pieces, "mesh", "-", *words, "-o", out + "x.ply")
            expect(code == 2 and "the format of standard input is unknown" in err, "%d %s" % (code, err))
        # Files of others are named as they are where a file is named.
        for first, what in ((gzip.compress(data[:9000]), "a gzip file"), (b"PK\3\4" + bytes(100), "a zip archive"), (b"ASTM-E57" + bytes(9000), "E57"),
                            (b"ply\nformat ascii 1.0\n", "PLY"), (b"ncols 2\nnrows 1\n1 2\n", "an ESRI ASCII grid")):
            for command in (["mesh", "-", "-o", out + "x.ply"], ["push", "named", "-"], ["info", "-"]):
                code, _, err = feed(d, [first], *command)
                expect(code == 1 and "standard input: this is " + what in err and "FILE" in err, "%s: %d %s" % (what, code, err))
        e2e.run([e2e.VERIFY, out, path]).ok()
        expect(not any(os.scandir(os.path.join(d.cache, "tmp"))), "something stayed in the cache")


def laz_is_kept():
    """A real file, if there are any: a compressed input must be kept whole before it is read."""
    data = e2e.data_dir()
    if not data:
        print("without real files: no LAZ through a pipe")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out = os.path.join(data, "lidar/las12_pdrf3_autzen_ft.laz"), os.path.join(base, "m.ply")
        want = digest(d, "-o", out, path)
        bytes_ = open(path, "rb").read()
        for words in (("--input-format", "las"), ()):
            code, text, err = feed(d, [bytes_[:1000], bytes_[1000:]], "mesh", "-", *words, "--json", "-o", out, pause=0.1)
            expect(code == 0, err)
            got = json.loads(text)
            expect((got["digest"], got["vertex_digest"], got["points"]) == want, text)
        code, text, err = feed(d, [bytes_], "info", "-", "--json")
        expect(code == 0 and json.loads(text)["records"] == want[2], "info: %d %s" % (code, err))


def cut_is_no_mesh():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        data, out = open(survey(base), "rb").read(), os.path.join(base, "m.ply")
        for n in (0, 3, 100, 227, 230, len(data) // 2, len(data) - 1):
            code, _, err = feed(d, [data[:n]], "mesh", "-", "--input-format", "las", "-o", out)
            expect(code == 1 and "standard input" in err, "%d bytes: %d %s" % (n, code, err))
            expect(not os.path.exists(out), "an output of %d bytes" % n)
        code, text, err = feed(d, [data[: len(data) // 2]], "mesh", "-", "--input-format", "las", "--accept-truncated", "-o", out)
        expect(code == 0 and os.path.exists(out), err)
        # A writer to a pipe that left the count open.
        none = bytearray(data)
        none[107:111] = bytes(4)
        if none[25] >= 4:
            none[247:255] = bytes(8)
        code, _, err = feed(d, [bytes(none)], "mesh", "-", "--input-format", "las", "-o", os.path.join(base, "n.ply"))
        expect(code == 1 and "no points, but bytes follow" in err, err)


def text_and_fifo():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out, fifo, txt = os.path.join(base, "m.obj"), os.path.join(base, "fifo"), os.path.join(base, "t.xyz")
        lines = "".join("%d.%d %d 1\n" % (i % 97, i % 10, i // 97) for i in range(20000)).encode()
        open(txt, "wb").write(lines)
        want = digest(d, "-o", out, txt)
        code, text, err = feed(d, [lines[:1000], lines[1000:]], "mesh", "-", "--input-format", "xyz", "-q", "-o", out, pause=0.1)
        expect(code == 0, err)
        os.mkfifo(fifo)
        run = d.ctl("mesh", "-o", out, fifo, "--input-format", "xyz", "--timeout", "0.5")
        expect(run.status == 124, "a named pipe without a writer: %d %s" % (run.status, run.err))
        writer = subprocess.Popen(["sh", "-c", 'cat "$0" > "$1"', txt, fifo])
        expect(digest(d, "-o", out, fifo, "--input-format", "xyz") == want, "by a named pipe")
        writer.wait(e2e.PATIENCE)


def text_forwards():
    """With a known lattice, a text is read as it comes: only its beginning is kept."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", threads=1) as d:
        out, txt = os.path.join(base, "m.ply"), os.path.join(base, "t.xyz")
        lines = "".join("%d.%03d %d.5 %d\n" % (500000 + i % 997, i % 1000, 4000000 + i // 997, i % 77) for i in range(150000)).encode()
        expect(len(lines) > 1 << 21, "a text of several buffers")
        open(txt, "wb").write(lines)
        want = digest(d, "-o", out, "--scale", "0.001,1", txt)
        for pieces in ([lines], [lines[:100], lines[100:300000], lines[300000:1000001], lines[1000001:]], [lines[:-1]]):
            code, text, err = feed(d, pieces, "mesh", "-", "--input-format", "xyz", "--scale", "0.001,1", "--json", "-o", out, pause=0.2)
            expect(code == 0, err)
            got = json.loads(text)
            expect((got["digest"], got["vertex_digest"], got["points"]) == want, text)
        for late, what in ((b"99999999999999999999 2 3\n", "more than 19 digits"), (b"1,5 2,5 3,5\n", "decimal commas"), (b"1 2\n", "fewer than three")):
            code, _, err = feed(d, [lines + late], "mesh", "-", "--input-format", "xyz", "--scale", "0.001,1", "-o", os.path.join(base, "n.ply"))
            expect(code == 1 and what in err and "150001" in err, err)
        # More digits than its beginning had: rounded as those of a file.
        late = b"500001.1234999999999999999999 4000000.9876500000000000000001 3.25\n"
        open(txt + "2", "wb").write(lines + late)
        code, text, err = feed(d, [lines + late], "mesh", "-", "--input-format", "xyz", "--scale", "0.001,1", "--json", "-o", out)
        expect(code == 0 and json.loads(text)["moved"] == 1, err)
        expect((json.loads(text)["digest"], json.loads(text)["vertex_digest"]) == digest(d, "-o", out, "--scale", "0.001,1", txt + "2")[:2], text)
        # Which point it was, counted from the first, though they came in pieces.
        code, _, err = feed(d, [lines, b"1 2 3\n" * 10], "mesh", "-", "--input-format", "xyz", "--scale", "0.001,1", "-o",
                            os.path.join(base, "n.ply"), pause=0.5)
        expect(code == 1 and "point 150000" in err, err)
        d.ctl("push", "valley", txt, "--scale", "0.001,1").ok()
        code, _, err = feed(d, [lines], "push", "valley", "-", "--input-format", "xyz")
        expect(code == 0, err)
        job = d.ctl("submit", "valley", "--wait", "--json").ok().json()
        expect(job["report"]["digest"] == want[0] if "report" in job else job["digest"] == want[0], str(job))


def slow_client_costs_nobody():
    """With one worker: others are served while clients hold half-filled pipes open."""
    with e2e.Folder() as base, e2e.Daemon(base, threads=1, memory="128M") as d:
        path, out = survey(base), os.path.join(base, "m.ply")
        data, slow = open(path, "rb").read(), []
        for n in (0, 100, 300, len(data) // 2):
            p = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "mesh", "-", "--input-format", "las", "-o", os.path.join(base, "slow%d.ply" % n)],
                                 stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            p.stdin.write(data[:n])
            p.stdin.flush()
            slow.append((p, n))
        # Where a client is when others are served is not known, and need not be: none of them can be further than its input.
        want = digest(d, "-o", out, path)
        e2e.until(lambda: d.ctl("status", "--json").ok().json()["connections"] == len(slow) + 1, "not all slow clients are connected")
        for p, n in slow[:2]:
            p.send_signal(signal.SIGINT)
            expect(p.wait(e2e.PATIENCE) == 130, "an interrupted client ended with %s" % p.returncode)
        for p, n in slow[2:]:
            p.stdin.write(data[n:])
            p.stdin.close()
            p.stdin = None
            p.communicate(timeout=e2e.PATIENCE)
            expect(p.returncode == 0, "a slow client ended with %d" % p.returncode)
            got = e2e.run([e2e.VERIFY, os.path.join(base, "slow%d.ply" % n), path])
            got.ok()
        expect(digest(d, "-o", out, path) == want, "afterwards")
        status = d.ctl("status", "--json").ok().json()
        held = {k: v for k, v in status["ledger"].items() if v} if isinstance(status["ledger"], dict) else status["ledger"]
        expect("stage" not in str(held) or not dict(held).get("stage"), "stage memory is held: %s" % held)


def quiet(d, most=1 << 30):
    """The number of the daemon's descriptors when nobody else is connected; waits until it is at most `most`."""
    seen = []

    def few():
        seen.append(len(os.listdir("/proc/%d/fd" % d.process.pid)))
        return seen[-1] <= most
    e2e.until(lambda: d.ctl("status", "--json").ok().json()["connections"] == 1, "clients that are gone stay connected")
    e2e.until(few, lambda: "%d descriptors, %d before" % (seen[-1], most))
    return seen[-1]


def vanished_clients():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = survey(base)
        data = open(path, "rb").read()
        # What is closed is closed aside: now and then one more is seen.
        before = min(quiet(d) for _ in range(5))
        for n in (0, 50, 250, 200000, len(data)):
            p = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, "push", "valley", "-", "--input-format", "las"],
                                 stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            p.stdin.write(data[:n])
            p.stdin.flush()
            # It is connected, and has done as much as it happens to have.
            e2e.until(lambda: p.poll() is not None or d.ctl("status", "--json").ok().json()["connections"] > 1, "it does not come")
            p.kill()
            p.wait()
            p.stdin.close()
            # Until its push is over the next one is told to come later.
            quiet(d, before)
        code, _, err = feed(d, [data], "push", "valley", "-", "--input-format", "las")
        expect(code == 0, err)


def aborted_beside_a_quiet_pipe():
    """A push can be aborted although another of its inputs has sent nothing yet."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        bad = os.path.join(base, "bad.las")
        open(bad, "wb").write(b"no points at all" * 30)
        for args in (("push", "valley", bad, "-", "--strict"), ("mesh", bad, "-", "--strict", "-o", os.path.join(base, "m.ply"))):
            p = subprocess.Popen([e2e.ACUTCTL, "--socket", d.socket, *args, "--input-format", "las"],
                                 stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            try:
                p.wait(e2e.PATIENCE)
            except subprocess.TimeoutExpired:
                p.kill()
            expect(p.returncode == 1, "ended with %s" % p.returncode)
            expect("bad.las" in p.stderr.read().decode(), "it does not say why")
            p.stdin.close()


def one_that_comes_late():
    """A pipe that is probed after the plan is checked against the dataset like a file."""
    try:
        from acut_wire import Client, Refused, pb
    except ImportError as e:
        print("not tried: %s" % e)
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = survey(base, 1000)
        other = las(os.path.join(base, "other.las"), [(x % 30, x // 30, 5) for x in range(1000)], scale=(.01, .01, .01))
        d.ctl("push", "valley", path).ok()
        for late, good in ((path, True), (other, False)):
            with Client(d.socket) as c:
                p = c.ask("push_begin", pb.PushBegin(dataset="valley")).push
                c.ask("push_plan", pb.PushPlan(push=p))
                _, fd = c.answer(c.send("stream", pb.Stream(push=p, name="late")), "streaming")
                with os.fdopen(fd, "wb") as f:
                    f.write(open(late, "rb").read())
                c.ask("probe", pb.Probe(push=p, name="late", format="las"))
                try:
                    c.ask("file", pb.File(push=p, name="late", format="las"))
                    expect(good, "it was staged")
                except Refused as e:
                    expect(not good and "coordinate system" in str(e), str(e))


def closed_once():
    """No descriptor is closed twice: in between, another thread may have got its number for another file."""
    if not shutil.which("strace"):
        e2e.unavailable("strace is not installed")
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, out, trace = survey(base, 3000), os.path.join(base, "m.ply"), os.path.join(base, "trace")
        data = open(path, "rb").read()
        spy = subprocess.Popen(["strace", "-f", "-e", "trace=close", "-o", trace, "-p", str(d.process.pid)], stderr=subprocess.PIPE)
        told = spy.stderr.readline().decode()
        if "attached" not in told:
            spy.wait()
            e2e.unavailable("strace: " + told.strip())
        for args in (("mesh", "-", "--input-format", "las", "-o", out), ("push", "d", "-", "--input-format", "las", "--name", "x")):
            code, _, err = feed(d, [data[:1000], data[1000:]], *args)
            expect(code == 0, err)
        expect(feed(d, [data[:1000]], "push", "d", "-", "--input-format", "las", "--name", "y")[0], "half a file was taken")
        d.ctl("info", path).ok()
        d.ctl("submit", "d", "--wait").ok()
        d.ctl("fetch", "2", "-o", out).ok()
        d.ctl("dataset", "export", "d", os.path.join(base, "copy")).ok()
        d.ctl("dataset", "import", os.path.join(base, "copy"), "e").ok()
        spy.terminate()
        spy.wait()
        closes = open(trace).read().splitlines()
        print("     %d descriptors were closed" % len(closes))
        bad = [line for line in closes if "EBADF" in line and "close(-1)" not in line]
        expect(len(closes) > 50 and not bad, "%s" % bad)


e2e.main(las_forwards, laz_is_kept, cut_is_no_mesh, text_and_fifo, text_forwards, slow_client_costs_nobody, vanished_clients,
         aborted_beside_a_quiet_pipe,
         one_that_comes_late, closed_once)
