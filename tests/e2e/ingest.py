"""acutctl ingest: a drop folder that people fill carelessly. Complete files are in the dataset once and in done/; broken files
are in failed/ with the reason; unfinished and foreign files stay. Nothing is ever overwritten or lost."""
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time

import e2e
from e2e import ACUTCTL, Folder, expect, main
from protocol import some_points, write_las

D = BASE = None


def drop(name):
    path = os.path.join(BASE, name)
    os.mkdir(path)
    return path


def las(path, points=500, seed=1):
    write_las(path, some_points(points, seed))
    return path


def ingest(dataset, folder, *args, status=0, settle="0", daemon=None):
    r = (daemon or D).ctl("ingest", dataset, folder, "--settle", settle, "--json", *args)
    expect(r.status == status, "ingest ended with %d, not %d\n%s%s" % (r.status, status, r.out, r.err))
    return {line["file"]: line for line in map(json.loads, r.out.splitlines()) if "file" in line}


def holds(folder, sub="."):
    return sorted(n for n in os.listdir(os.path.join(folder, sub)) if sub != "." or n not in ("done", "failed"))


def files_of(dataset):
    """The live files and the points of the dataset."""
    r = D.ctl("dataset", "show", dataset, "--json").ok().json()
    return r["files"], r["points"]


def reason(folder, name):
    with open(os.path.join(folder, "failed", name + ".error")) as f:
        return json.load(f)


def numbers():
    """The number of connections so far: the leftovers of a failed push are removed when its connection ends."""
    for line in D.ctl("metrics").ok().out.splitlines():
        if line.startswith("acut_connections_total"):
            return int(float(line.split()[-1]))
    raise e2e.Fault("acutd does not count connections")


def good_and_bad_and_not_ours():
    f = drop("mixed")
    for i in range(3):
        las(os.path.join(f, "good%d.las" % i), seed=i)
    for n in (".hidden.las", "half.las.part", "half.las.tmp", "backup.las~"):
        las(os.path.join(f, n))
    with open(os.path.join(f, "good0.las"), "rb") as src:
        data = src.read()
    for name, content in (("torn.las", data[:-30]), ("text.pdf", b"%PDF-1.4 nothing\0\1\2" * 40), ("empty.las", b"")):
        with open(os.path.join(f, name), "wb") as out:
            out.write(content)
    os.mkdir(os.path.join(f, "sub"))
    las(os.path.join(f, "sub", "below.las"))
    secret = las(os.path.join(BASE, "secret.las"), seed=99)
    os.symlink(secret, os.path.join(f, "link.las"))
    os.symlink("/nonexistent", os.path.join(f, "dangling.las"))
    os.mkfifo(os.path.join(f, "fifo.las"))
    bound = socket.socket(socket.AF_UNIX)
    here = os.getcwd()
    os.chdir(f)
    bound.bind("socket.las")
    os.chdir(here)
    device = os.path.join(f, "zero.las")
    if os.geteuid() == 0:
        try:
            os.mknod(device, 0o20666, os.makedev(1, 5))
        except PermissionError:
            pass
    ours = ["good0.las", "good1.las", "good2.las", "torn.las", "text.pdf", "empty.las"]
    left = [n for n in holds(f) if n not in ours]
    got = ingest("mixed", f, status=3)
    expect(sorted(got) == sorted(ours), "told of %s" % sorted(got))
    expect(holds(f) == left, "left: %s" % holds(f))
    expect(holds(f, "done") == ["good0.las", "good1.las", "good2.las"], "done: %s" % holds(f, "done"))
    expect(holds(f, "failed") == sorted(n + e for n in ("torn.las", "text.pdf", "empty.las") for e in ("", ".error")),
           "failed: %s" % holds(f, "failed"))
    expect(reason(f, "torn.las")["error"]["code"] == "truncated", "torn: %s" % reason(f, "torn.las"))
    for n in ("text.pdf", "empty.las"):
        why = reason(f, n)
        expect(why["error"]["code"] in ("bad-input", "truncated") and why["error"]["message"] and why["dataset"] == "mixed" and why["time"],
               "%s: %s" % (n, why))
        expect(got[n]["state"] == "refused" and got[n]["moved_to"] == "failed/" + n, "told: %s" % got[n])
    expect(got["good1.las"]["moved_to"] == "done/good1.las" and got["good1.las"]["points"] == 500, "told: %s" % got["good1.las"])
    expect(files_of("mixed") == (3, 1500), "the dataset has %s" % (files_of("mixed"),))
    # Again: nothing to do, nothing said, and no daemon asked.
    r = e2e.run([ACUTCTL, "ingest", "mixed", f, "--settle", "0", "--json"], env={"ACUT_SOCKET": "/nonexistent"})
    expect((r.status, r.out, r.err) == (0, "", ""), "again: %d %s%s" % (r.status, r.out, r.err))
    bound.close()
    # All refused is a failure, and each of them is told.
    las(os.path.join(f, "x.las"))
    os.truncate(os.path.join(f, "x.las"), 300)
    got = ingest("mixed", f, status=1)
    expect(got["x.las"]["moved_to"] == "failed/x.las", "told: %s" % got)


def a_flood_of_refusals():
    """Each refused file is reported and moved. After a hundred lines there is only a count, here and in the daemon's log."""
    f = drop("flood")
    for n in range(130):
        with open(os.path.join(f, "%03d.las" % n), "w") as out:
            out.write("no points %d" % n)
    own, begun = os.path.join(BASE, "flooded"), time.monotonic()
    os.mkdir(own)
    with e2e.Daemon(own) as d:
        r = d.ctl("ingest", "flood", f, "--settle", "0")
        told = [line for line in r.err.splitlines() if ".las: " in line]
        last = [line for line in r.err.splitlines() if line.startswith("acutctl:")][-1]
        expect(r.status == 1 and len(told) == 100, "%d, %d lines: %s" % (r.status, len(told), r.err[-600:]))
        expect(last.endswith("30 more inputs were refused, 130 in all"), last)
        expect(len([n for n in holds(f, "failed") if n.endswith(".error")]) == 130, "not each has its reason")
        log = [line for line in d.log_text().splitlines() if "into flood: a file is refused" in line]
        # A hundred in each half minute since the first of them, however many of these the pass takes.
        most = 100 * (1 + int((time.monotonic() - begun) / 30))
        expect(100 <= len(log) <= most, "%d lines in the log, and %d at most" % (len(log), most))
        expect("acut_files_refused_total" in d.ctl("metrics").ok().out, "the count")
    # If other files are good, JSON has each file, and the last line has the number of refused ones.
    e2e.run([e2e.SYNTH, "--points", "1000", os.path.join(f, "failed", "good.las")]).ok()
    r = D.ctl("push", "flood", *(os.path.join(f, "failed", n) for n in holds(f, "failed") if n.endswith(".las")))
    expect(r.status == 3 and r.err.splitlines()[-1].endswith("30 more inputs were refused, 130 in all: --json lists each"), r.err[-600:])


def delivered_again():
    """The same bytes under the same or another name are not added twice; other bytes under a known name are reported."""
    f = drop("again")
    path = os.path.join(f, "scan.las")
    las(path)
    ingest("again", f)
    for n in range(1, 3):
        las(path)
        os.utime(path, (1e9 + n, 1e9 + n))
        got = ingest("again", f)
        expect(got["scan.las"]["state"] == "known" and got["scan.las"]["moved_to"] == "done/scan.%d.las" % n, "told: %s" % got)
    las(os.path.join(f, "other name.las"))
    expect(ingest("again", f)["other name.las"]["state"] == "known", "another name was taken")
    expect(files_of("again") == (1, 500), "the dataset has %s" % (files_of("again"),))
    las(path, seed=5)
    ingest("again", f, status=1)
    expect("--replace" in reason(f, "scan.las")["error"]["hint"], "no hint: %s" % reason(f, "scan.las"))
    expect(files_of("again") == (1, 500), "the dataset has %s" % (files_of("again"),))
    las(path, seed=5)
    ingest("again", f, status=1)
    expect(holds(f, "failed") == ["scan.1.las", "scan.1.las.error", "scan.las", "scan.las.error"], "failed: %s" % holds(f, "failed"))
    las(path, points=600, seed=5)
    ingest("again", f, "--replace")
    expect(files_of("again") == (1, 600), "the dataset has %s" % (files_of("again"),))


def twins():
    """Several files with the same content in one pass: the content is in the dataset once."""
    f = drop("twins")
    las(os.path.join(f, "old.las"))
    ingest("twins", f)
    for n in range(4):
        las(os.path.join(f, "new%d.las" % n), seed=7)
        las(os.path.join(f, "old%d.las" % n))
    las(os.path.join(f, "other.las"), seed=8)  # of the same size
    got = ingest("twins", f)
    expect([got[n]["state"] for n in sorted(got)] == ["staged"] + ["known"] * 7 + ["staged"], "told: %s" % got)
    expect(files_of("twins") == (3, 1500) and not holds(f), "the dataset has %s, %s" % (files_of("twins"), holds(f)))
    # A refusal for its name takes nothing from the twin that is taken.
    for n in ("new0.las", "zz1.las", "zz2.las"):
        las(os.path.join(f, n), seed=9)
    got = ingest("twins", f, status=3)
    expect([got[n]["state"] for n in sorted(got)] == ["refused", "staged", "known"], "told: %s" % got)
    expect(files_of("twins") == (4, 2000), "the dataset has %s" % (files_of("twins"),))
    # Broken ones are refused, each.
    for n in range(3):
        las(os.path.join(f, "torn%d.las" % n), seed=6)
        os.truncate(os.path.join(f, "torn%d.las" % n), 3000)
    expect([g["state"] for g in ingest("twins", f, status=1).values()] == ["refused"] * 3, "broken twins")
    # Thousands of them are told by one, each with the error of its own; what has another ending is looked at, and so is one of
    # the same content that is whole under a name that is taken.
    broken = las(os.path.join(BASE, "broken.las"), seed=10)
    os.truncate(broken, 3000)
    for n in range(1200):
        shutil.copy(broken, os.path.join(f, "b%04d.las" % n))
    shutil.copy(broken, os.path.join(f, "b.laz"))
    las(os.path.join(f, "new0.las"), seed=11)
    las(os.path.join(f, "zz3.las"), seed=11)
    # A file that is not LAS may be a text: the name decides its kind.
    for n in ("p0.las", "p1.las", "pz.xyz"):
        with open(os.path.join(f, n), "w") as out:
            out.write("1 2 3\n400 5 6\n7 800 9\n")
    asked = numbers()
    start = time.monotonic()
    got = ingest("twins", f, status=3)
    seconds = time.monotonic() - start
    asked = numbers() - asked
    expect([got[n]["state"] for n in ("new0.las", "zz3.las", "b.laz")] == ["refused", "staged", "refused"], "told: %s" % got["zz3.las"])
    expect([got[n]["state"] for n in ("p0.las", "p1.las", "pz.xyz")] == ["refused", "refused", "staged"], "by name: %s" % got["pz.xyz"])
    expect(len(got) == 1206 and all(got["b%04d.las" % n]["moved_to"] == "failed/b%04d.las" % n for n in range(1200)), "%d told" % len(got))
    for n in (0, 1, 1199):
        why = reason(f, "b%04d.las" % n)
        expect(why["file"] == "b%04d.las" % n and why["error"]["code"] == reason(f, "b0000.las")["error"]["code"] and
               why["error"]["file"] == "b%04d.las" % n, "%s" % why)
    expect(not holds(f) and files_of("twins") == (6, 2503), "%s %s" % (holds(f)[:5], files_of("twins")))
    print("     1200 broken files of one content in %.1f s, %d pushes" % (seconds, asked))
    expect(asked <= 5, "%d pushes for 1200 files of one content" % asked)


def said(run):
    return run.out + run.err


def room_where_it_matters():
    """A pass reports the room that is left on the lattice only if it is little; a push by hand always does."""
    f = drop("room")
    expect("room left" in said(D.ctl("push", "byhand", las(os.path.join(BASE, "hand.las"), seed=1)).ok()), "a push says nothing")
    las(os.path.join(f, "a.las"), seed=1)
    told = said(D.ctl("ingest", "room", f, "--settle", "0").ok())
    expect("points" in told and "room left" not in told, told)
    las(os.path.join(f, "a.las"), seed=1)
    told = said(D.ctl("ingest", "tight", f, "--settle", "0", "--scale", "0.00000025").ok())
    expect("room left" in told, told)


def odd_names():
    f = os.fsencode(drop("odd"))
    names = [b"new\nline.las", b"\xff\xfe.las", b"-rf.las", b"@list.las", b"\x1b[31m.las", b"n" * 251 + b".las", b"no extension", b"a.b"]
    for i, n in enumerate(names):
        las(os.path.join(f, n), points=50, seed=i)
    ingest("odd", os.fsdecode(f))
    expect(sorted(os.listdir(f + b"/done")) == sorted(names), "done: %s" % os.listdir(f + b"/done"))
    for i, n in enumerate(names):
        las(os.path.join(f, n), points=50, seed=i)
        os.truncate(os.path.join(f, n), 600)
    r = D.ctl("ingest", "odd", os.fsdecode(f), "--settle", "0")
    expect(r.status == 1 and "\x1b" not in r.err + r.out, "%d %r" % (r.status, r.err))
    got = os.listdir(f + b"/failed")
    expect(len(got) == 2 * len(names) and all(n + b".error" in got for n in got if not n.endswith(b".error")), "failed: %s" % got)
    for i, n in enumerate(names):
        las(os.path.join(f, n), points=50, seed=i)
    ingest("odd", os.fsdecode(f))
    expect(len(os.listdir(f + b"/done")) == 2 * len(names) and not os.path.exists(os.path.join(f, names[5])), "long names stay")


def half_copied():
    """Files that grow between two passes are left alone, however long a pass takes and whatever their times are. They are pushed
    when they were unchanged for the time of --settle."""
    f = drop("growing")
    whole = las(os.path.join(BASE, "whole.las"), points=20000, seed=3)
    with open(whole, "rb") as src:
        data = src.read()
    las(os.path.join(f, "still.las"), seed=4)
    names = ["grows-a.las", "grows-b.las"]
    gate, looks, at = e2e.Gate(BASE), 0, 0

    def grow(by):
        nonlocal at
        for name in names:
            with open(os.path.join(f, name), "ab") as out:
                out.write(data[at:at + by])
                out.flush()
                os.utime(out.fileno(), (1e9, 1e9))
        at += by

    grow(4000)
    # Held in the first look when one of the two was seen, in the others before.
    gate.close("fstatat", "grows-", 1)
    p = subprocess.Popen([ACUTCTL, "ingest", "growing", f, "--settle", "0.5", "--json"], env=dict(os.environ, ACUT_SOCKET=D.socket, **gate.env),
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while gate.wait(lambda: p.poll() is not None):
        looks += 1
        if looks == 1:
            time.sleep(0.6)  # what was seen in this look was seen once
            gate.close("fstatat", "grows-", 1)
        else:
            grow(1000)
            gate.close("fstatat", "grows-", 2)
    gate.open()
    said, err = p.communicate(timeout=e2e.PATIENCE)
    expect(p.returncode == 0 and looks > 2 and at < len(data), "%d after %d looks: %s" % (p.returncode, looks, err))
    got = [line["file"] for line in map(json.loads, said.splitlines()) if "file" in line]
    expect(got == ["still.las"], "taken while it grew: %s" % got)
    grow(len(data) - at)
    os.unlink(os.path.join(f, names.pop()))
    start = time.monotonic()
    got = ingest("growing", f, settle="0.5")
    expect(sorted(got) == names and got[names[0]]["points"] == 20000, "told: %s" % got)
    expect(time.monotonic() - start >= 0.5, "it was not watched")
    expect(holds(f) == [] and files_of("growing") == (2, 20500), "%s %s" % (holds(f), files_of("growing")))
    # A clock that was wrong when the file came, an hour ahead or behind, changes nothing: nobody asks it.
    las(os.path.join(f, "future.las"), seed=6)
    os.utime(os.path.join(f, "future.las"), (4e9, 4e9))
    expect("future.las" in ingest("growing", f, settle="0.2"), "a time to come is waited for")


def changed_while_pushed():
    """A file that is rewritten or replaced between its push and its move stays; the next pass pushes it as it is."""
    f = drop("swapped")
    las(os.path.join(f, "a.las"), seed=1)
    las(os.path.join(f, "b.las"), seed=2)
    gate = e2e.Gate(BASE)
    gate.close("renameat2", "/a.las")
    p = subprocess.Popen([ACUTCTL, "ingest", "swapped", f, "--settle", "0", "--json"], env=dict(os.environ, ACUT_SOCKET=D.socket, **gate.env),
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    gate.wait()
    las(os.path.join(BASE, "new.las"), seed=3)
    os.rename(os.path.join(BASE, "new.las"), os.path.join(f, "a.las"))
    with open(os.path.join(f, "b.las"), "ab") as out:
        out.write(b"more")
    gate.open()
    out, err = p.communicate(timeout=e2e.PATIENCE)
    expect(p.returncode == 0, "%d %s" % (p.returncode, err))
    lines = {line["file"]: line for line in map(json.loads, out.decode().splitlines()) if "file" in line}
    expect(lines["a.las"]["moved_to"] is None and lines["b.las"]["moved_to"] is None, "moved: %s" % lines)
    expect(holds(f) == ["a.las", "b.las"] and holds(f, "done") == [], "%s %s" % (holds(f), holds(f, "done")))
    ingest("swapped", f, "--add")
    expect(holds(f) == [] and files_of("swapped")[0] in (3, 4), "%s" % (files_of("swapped"),))


def killed_between_commit_and_move():
    f = drop("killed")
    for i in range(5):
        las(os.path.join(f, "%d.las" % i), seed=i)
    for when, left in ((1, 5), (3, 3)):
        r = e2e.run(["strace", "-f", "-qq", "-o", "/dev/null", "-e", "trace=renameat2", "-e", "inject=renameat2:signal=KILL:when=%d" % when,
                     ACUTCTL, "ingest", "killed", f, "--settle", "0"], env={"ACUT_SOCKET": D.socket})
        expect(r.status in (-signal.SIGKILL, 137), "not killed: %d %s%s" % (r.status, r.out, r.err))
        expect(files_of("killed") == (5, 2500), "after the kill: %s" % (files_of("killed"),))
        # strace kills on the way out of the call: that rename has happened, or not.
        expect(len(holds(f)) in (left, left - 1), "left: %s" % holds(f))
    got = ingest("killed", f)
    expect(all(line["state"] == "known" for line in got.values()), "taken again: %s" % got)
    expect(holds(f) == [] and len(holds(f, "done")) == 5 and files_of("killed") == (5, 2500), "%s" % (files_of("killed"),))
    # Killed while it pushes: the rest of it is made good by the next pass.
    for i in range(5, 10):
        las(os.path.join(f, "%d.las" % i), seed=i)
    with e2e.Folder() as other:
        # Its daemon stands still when it reads the third.
        gate = e2e.Gate(other)
        D.stop()
        D.env.update(gate.env)
        D.start()
        gate.close("pread", "/7.las", 2)
        p = subprocess.Popen([ACUTCTL, "ingest", "killed", f, "--settle", "0"], env=dict(os.environ, ACUT_SOCKET=D.socket),
                             stdout=subprocess.DEVNULL)
        gate.wait()
        p.kill()
        p.wait()
        gate.open()
        D.stop()
        for name in gate.env:
            D.env.pop(name)
        D.start()
    e2e.until(lambda: D.ctl("ingest", "killed", f, "--settle", "0") and not holds(f), "what a killed one has begun is never done")
    expect(holds(f) == [] and files_of("killed") == (10, 5000), "%s %s" % (holds(f), files_of("killed")))


def is_locked(folder):
    """True if a process has the lock of the drop folder. Does not take the lock, which would keep others from it."""
    with open("/proc/locks") as locks:
        return any(line.split()[5].endswith(":%d" % os.stat(folder).st_ino) for line in locks if "FLOCK" in line and "->" not in line)


def nobody_to_push_to():
    """Temporary failures leave the files where they are."""
    f = drop("away")
    las(os.path.join(f, "a.las"))
    r = e2e.run([ACUTCTL, "ingest", "away", f, "--settle", "0"], env={"ACUT_SOCKET": os.path.join(BASE, "nobody.sock")})
    expect(r.status == 69, "no daemon: %d %s" % (r.status, r.err))
    expect(holds(f) == ["a.las"] and holds(f, "failed") == [], "no daemon: %s" % holds(f))
    os.mkdir(os.path.join(BASE, "full"))
    with e2e.Daemon(os.path.join(BASE, "full"), memory="64M", args=("--disk", "1M")) as full:
        las(os.path.join(f, "big.las"), points=60000, seed=7)
        got = ingest("away", f, daemon=full, status=74)
        expect(holds(f) == ["big.las"] and holds(f, "failed") == [] and holds(f, "done") == ["a.las"],
               "no space: %s, done %s, failed %s\n%s" % (holds(f), holds(f, "done"), holds(f, "failed"), got))
    got = ingest("away", f)
    expect(holds(f) == [] and len(holds(f, "done")) == 2, "afterwards: %s" % got)
    # A daemon that goes in the middle.
    os.mkdir(os.path.join(BASE, "short"))
    with e2e.Daemon(os.path.join(BASE, "short"), memory="64M") as short:
        for i in range(40):
            las(os.path.join(f, "c%d.las" % i), points=2000, seed=20 + i)
        p = subprocess.Popen([ACUTCTL, "ingest", "away", f, "--settle", "0.3"], env=dict(os.environ, ACUT_SOCKET=short.socket),
                             stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        e2e.until(lambda: p.poll() is not None or is_locked(f), "it does not begin")
        short.process.kill()
        _, err = p.communicate(timeout=e2e.PATIENCE)
        expect(p.returncode in (69, 0) and len(holds(f)) in (40, 0), "%d, %d left: %s" % (p.returncode, len(holds(f)), err))


def one_at_a_time():
    f = drop("busy")
    las(os.path.join(f, "a.las"))
    p = subprocess.Popen([ACUTCTL, "ingest", "busy", f, "--settle", "600"], env=dict(os.environ, ACUT_SOCKET=D.socket),
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    e2e.until(lambda: is_locked(f), "it does not begin")
    r = D.ctl("ingest", "busy", f, "--settle", "0")
    expect(r.status == 75 and "another ingest" in r.err, "beside another: %d %s" % (r.status, r.err))
    p.send_signal(signal.SIGTERM)
    expect(p.wait(e2e.PATIENCE) == 143 and holds(f) == ["a.las"], "ended with %d" % p.returncode)
    p.stdout.close()
    p.stderr.close()
    ingest("busy", f)
    expect(holds(f) == [], "left: %s" % holds(f))


def folders_that_cannot_be_used():
    r = D.ctl("ingest", "none", os.path.join(BASE, "no such folder"))
    expect(r.status == 1, "no folder: %d %s" % (r.status, r.err))
    f = drop("linked")
    las(os.path.join(f, "a.las"))
    os.symlink("/tmp", os.path.join(f, "done"))
    r = D.ctl("ingest", "linked", f, "--settle", "0")
    expect(r.status == 74 and holds(f) == ["a.las"], "done/ is a link: %d %s" % (r.status, r.err))
    expect(D.ctl("dataset", "show", "linked").status == 4, "it was pushed all the same")
    os.remove(os.path.join(f, "done"))
    for option in (("--manifest", "x"), ("--replaces", "x"), ("--settle", "soon"), ("--settle", "-1"), ("--add", "--replace")):
        r = D.ctl("ingest", "linked", f, *option)
        expect(r.status == 2, "%s: %d %s" % (option, r.status, r.err))
    if os.geteuid() == 0 and shutil.which("setpriv"):
        os.chmod(BASE, 0o755)
        os.mkdir(os.path.join(f, "done"))
        os.mkdir(os.path.join(f, "failed"))
        r = e2e.run(["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups", ACUTCTL, "ingest", "linked", f, "--settle", "0"],
                    env={"ACUT_SOCKET": D.socket})
        if "No such file" not in r.err and r.status != 127:
            expect(r.status == 77 and holds(f) == ["a.las"], "not writable: %d %s" % (r.status, r.err))
    # No name is not a dataset: nothing is moved.
    f = drop("unset")
    las(os.path.join(f, "a.las"))
    r = D.ctl("ingest", "", f, "--settle", "0")
    expect(r.status == 2 and holds(f) == ["a.las"], "no name: %d %s" % (r.status, r.err))
    # Refused as a whole, with --strict: the bad one is out of the way, and the next pass takes the others.
    f = drop("strict")
    las(os.path.join(f, "a.las"))
    las(os.path.join(f, "b.las"), seed=2)
    os.truncate(os.path.join(f, "b.las"), 400)
    ingest("strict", f, "--strict", status=1)
    expect(holds(f) == ["a.las"] and holds(f, "failed") == ["b.las", "b.las.error"], "%s %s" % (holds(f), holds(f, "failed")))
    ingest("strict", f, "--strict")
    expect(holds(f, "done") == ["a.las"], "done: %s" % holds(f, "done"))


def many_tiny_files():
    f = drop("many")
    one = las(os.path.join(BASE, "tiny.las"), points=4)
    with open(one, "rb") as src:
        data = bytearray(src.read())
    n = int(os.environ.get("ACUT_INGEST_FILES", 2000))
    for i in range(n):
        data[227:231] = (i * 7 % 90000).to_bytes(4, "little")
        data[90] = i % 250
        data[92] = i // 250
        with open(os.path.join(f, "%05d.las" % i), "wb") as out:
            out.write(data if i % 100 else data[:-3])
    start = time.monotonic()
    r = D.ctl("ingest", "many", f, "--settle", "0", "--quiet")
    seconds = time.monotonic() - start
    expect(r.status == 3, "%d %s" % (r.status, r.err[-1000:]))
    expect(holds(f) == [] and len(holds(f, "done")) == n - n // 100 and len(holds(f, "failed")) == n // 50,
           "%d left, %d done" % (len(holds(f)), len(holds(f, "done"))))
    print("     %d files, %d of them broken, in %.1f s" % (n, n // 100, seconds))


def whole():
    global D, BASE
    with Folder() as base, e2e.Daemon(base, memory="128M") as daemon:
        D, BASE = daemon, base
        try:
            main(good_and_bad_and_not_ours, a_flood_of_refusals, delivered_again, twins, room_where_it_matters, odd_names, half_copied, changed_while_pushed,
                 killed_between_commit_and_move, nobody_to_push_to, one_at_a_time, folders_that_cannot_be_used, many_tiny_files)
        except SystemExit as e:
            status = e.code
    sys.exit(status)


if __name__ == "__main__":
    whole()
