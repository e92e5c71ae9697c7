"""acutctl on the remote side of a real ssh: binary streams in both directions, exit statuses, and broken connections.

The client's ProxyCommand runs the server, without a network, with keys in a temporary folder.
"""
import getpass
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import Daemon, Folder, expect  # noqa: E402

SSHD = shutil.which("sshd", path=os.environ.get("PATH", "") + ":/usr/sbin")
ACUTCTL = os.path.abspath(e2e.ACUTCTL)
PRIVSEP = "/run/sshd"  # a server started by root needs this folder; its service makes it


class Box:
    """The remote side: an acutd, and an sshd that a client starts."""

    def __init__(self, base, daemon):
        self.base = base
        for key in ("host", "user"):
            subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", base + "/" + key], check=True,
                           stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        shutil.copy(base + "/user.pub", base + "/authorized")
        with open(base + "/sshd_config", "w") as f:
            f.write("HostKey %s/host\nAuthorizedKeysFile %s/authorized\nStrictModes no\nUsePAM no\nPidFile none\n"
                    "PermitRootLogin yes\nPasswordAuthentication no\nSetEnv ACUT_SOCKET=%s\nLogLevel ERROR\n" % (base, base, daemon.socket))
        self.shared = ["-o", "ControlPath=" + base + "/cm"]
        self.command = ["ssh", "-F", "none", "-i", base + "/user", "-o", "ProxyCommand=%s -i -f %s/sshd_config" % (SSHD, base),
                        "-o", "StrictHostKeyChecking=no", "-o", "UserKnownHostsFile=/dev/null", "-o", "BatchMode=yes",
                        "-o", "LogLevel=ERROR", "-T"]
        self.words = [getpass.getuser() + "@box", ACUTCTL]
        # One connection for commands that are not interrupted.
        self.master = subprocess.Popen(self.command + self.shared + ["-M", "-N", self.words[0]], stdin=subprocess.DEVNULL,
                                       stdout=subprocess.DEVNULL, stderr=open(base + "/ssh.log", "w"))
        end = time.monotonic() + e2e.PATIENCE
        while not os.path.exists(base + "/cm") and self.master.poll() is None and time.monotonic() < end:
            time.sleep(0.02)

    def end(self):
        self.master.terminate()
        self.master.wait()

    def run(self, *words, data=None, **kw):
        p = subprocess.run(self.command + self.shared + self.words + list(words), input=data, stdin=subprocess.DEVNULL if data is None else None,
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE, **kw)
        return p.returncode, p.stdout, p.stderr.decode()

    def start(self, *words):
        return subprocess.Popen(self.command + self.words + list(words), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def survey(path, points=40000, seed=1):
    e2e.run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    with open(path, "rb") as f:
        return f.read()


def far_end(mark):
    """True if the acutctl with this time-out runs on the remote side."""
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open("/proc/%s/cmdline" % pid, "rb") as f:
                words = f.read().split(b"\0")
        except OSError:
            continue
        if words[0] == ACUTCTL.encode() and mark.encode() in words:
            return True
    return False


def cut(p, data, mark, d):
    """Sends the data, waits until the remote side has it, and kills the client."""
    try:
        p.stdin.write(data)
        p.stdin.flush()
    except BrokenPipeError:
        raise e2e.Fault("ended before it was cut: %s %s" % (p.wait(), p.stderr.read()))
    e2e.until(lambda: far_end(mark) or p.poll() is not None, "nothing runs on the remote side")
    expect(p.poll() is None, "ended before it was cut: %s" % (p.communicate() if p.poll() is not None else "",))
    time.sleep(0.5)
    p.kill()
    p.stdin.close()
    p.wait()
    e2e.until(lambda: not far_end(mark), "acutctl still runs on the remote side")
    # The next command finds that the push has ended.
    e2e.until(lambda: d.ctl("status", "--json").ok().json()["connections"] == 1, "acutd does not notice that it is gone")


def both_ways(base, box, d):
    las = survey(base + "/a.las")
    got = box.run("push", "valley", "-", "--input-format", "las", "--name", "T1", data=las)
    expect(got[0] == 0 and b"40,000 points" in got[1], "push: %s" % (got,))
    names = [f["name"] for f in d.ctl("dataset", "log", "valley", "--files", "--json").ok().json()["files"]]
    expect(names == ["T1"], "the name of a stream: %s" % names)
    # With a checksum the same file is not pushed twice. Another one with its name is refused, or replaces it.
    for name, more, status in (("S", [], 0), ("S", [], 0), ("S", ["other"], 1), ("S", ["other", "--replace"], 0)):
        data = b"0 0 1\n10 0 2\n0 10 3\n" + (b"5 5 5\n" if more else b"")
        got = box.run("push", "small", "-", "--input-format", "xyz", "--name", name, "--checksum", *more[1:], data=data)
        expect(got[0] == status, "%s: %s" % (more, got))
    small = d.ctl("dataset", "show", "small", "--json").ok().json()
    expect((small["points"], small["files"], small["generation"]) == (4, 1, 2), "%s" % small)
    got = box.run("submit", "valley", "--wait", "--json")
    job = json.loads(got[1])
    expect(got[0] == 0 and job["triangles"] > 0, "submit: %s" % (got,))
    near = subprocess.run([ACUTCTL, "fetch", str(job["job"]), "-o", "-", "-q"], stdout=subprocess.PIPE, check=True, timeout=e2e.PATIENCE,
                          env=dict(os.environ, ACUT_SOCKET=d.socket)).stdout
    got = box.run("fetch", str(job["job"]), "-o", "-", "--format", "ply")
    expect(got[0] == 0 and hashlib.sha256(got[1]).digest() == hashlib.sha256(near).digest(),
           "fetched %d bytes, %d near by: %s" % (len(got[1]), len(near), got[2]))
    expect("triangles" in got[2], "the report stands on standard error: " + got[2])
    # Without --format it is PLY, as the manual's example has it.
    got = box.run("fetch", str(job["job"]), "-o", "-", "--json")
    expect(got[0] == 0 and got[1] == near and json.loads(got[2])["digest"] == job["digest"], got[2])
    # One step; nothing remains on the remote side.
    got = box.run("mesh", "-", "--input-format", "las", "-o", "-", "--quiet", data=las)
    expect(got[0] == 0 and got[1].startswith(b"ply\n") and got[2] == "", "mesh: %s %s" % (got[0], got[2]))


def laz(base, box, d):
    folder = e2e.data_dir()
    path = folder and next((os.path.join(r, n) for r, _, names in sorted(os.walk(os.path.join(folder, "lidar"))) for n in sorted(names)
                            if n.lower().endswith(".laz") and os.path.getsize(os.path.join(r, n)) < 4 << 20), None)
    if not path:
        print("laz over ssh: no real data, left out")
        return
    with open(path, "rb") as f:
        data = f.read()
    got = box.run("push", "real", "-", "--input-format", "laz", "--name", "T1", data=data)
    expect(got[0] == 0, "push of LAZ: %s" % (got,))
    d.ctl("push", "near", path).ok()
    points = [d.ctl("dataset", "show", n, "--json").ok().json()["points"] for n in ("real", "near")]
    expect(points[0] == points[1] > 0, "points: %s" % points)


def statuses(base, box, d):
    for words, data, status, said in (
            (("fetch", "99999", "-o", "-"), None, 4, "99999"), (("fetch", "1"), None, 2, "no output"),
            (("push", "broken", "-", "--input-format", "las"), b"not a LAS file at all", 1, "standard input"),
            (("submit", "nothing"), None, 4, "nothing"), (("jobs", "--socket", base + "/none"), None, 69, "none"),
            (("wait", "1", "--timeout", str(e2e.PATIENCE)), None, 0, "")):
        got = box.run(*words, data=data)
        expect(got[0] == status and said in got[2] + got[1].decode(), "%s: %s" % (words, got))
        expect(status == 0 or got[1] == b"", "an error on standard output: %s" % (got,))


def ends_one_after_the_other(d, finish):
    """A stream without ssh, whose ends are closed as sshd closes them: standard error only by finish(p, err), which runs when acutctl
    waits for that. Its exit status."""
    (stdin, feed), (out, stdout), (err, stderr) = (os.pipe() for _ in range(3))
    p = subprocess.Popen([ACUTCTL, "push", "new", "-", "--input-format", "xyz"], stdin=stdin, stdout=stdout, stderr=stderr,
                         env=dict(os.environ, ACUT_SOCKET=d.socket))
    for fd in (stdin, stdout, stderr):
        os.close(fd)
    os.write(feed, b"0 0 1\n10 0 2\n0 10 3\n")
    os.close(out)
    os.close(feed)
    time.sleep(1)  # of the five that it waits
    finish(p, err)
    return p.wait(e2e.PATIENCE)


def cut_off(base, box, d):
    names = lambda: {r["name"]: r["generation"] for r in map(json.loads, d.ctl("datasets", "--json").ok().out.splitlines())}
    before, mark = names(), "600.%d" % os.getpid()
    las = survey(base + "/b.las", 400000, 2)
    text = "".join("%d.%02d %d.%02d %d.5\n" % (i % 997, i % 89, i // 997, i % 97, i % 13) for i in range(40000)).encode()
    # The connection breaks within a file whose length is known, and within one without: into a new and an old dataset.
    for name in ("valley", "new"):
        for kind, data in (("las", las[:len(las) // 2]), ("xyz", text)):
            # Texts have neither coordinate system nor units, and the old dataset has both.
            more = ["--assume-crs", "EPSG:32633", "--assume-units", "m,m"] if (name, kind) == ("valley", "xyz") else []
            p = box.start("push", name, "-", "--input-format", kind, "--name", "cut", "--timeout", mark, *more)
            cut(p, data, mark, d)
            got = names()
            expect(got.get("valley") == before["valley"] and got.get("new", 0) == 0, "a half of %s: %s" % (kind, got))
    status = ends_one_after_the_other(d, lambda p, err: os.close(err))
    expect(status == 1 and names().get("new", 0) == 0, "ends that were closed one after the other: %s, %s" % (status, names()))
    status = ends_one_after_the_other(d, lambda p, err: p.send_signal(signal.SIGTERM))
    expect(status == 128 + signal.SIGTERM and names().get("new", 0) == 0, "interrupted between the ends: %s, %s" % (status, names()))
    # Later the whole file is pushed.
    p = box.run("push", "new", "-", "--input-format", "xyz", "--name", "cut", data=text)
    expect(p[0] == 0 and names()["new"] == 1 and d.ctl("dataset", "show", "new", "--json").json()["points"] == 40000, "%s" % (p,))
    # A stream without a reader and a wait without a client end, too; the job is there afterwards.
    d.ctl("push", "big", base + "/b.las").ok()
    job = d.ctl("submit", "big", "--wait", "--json").ok().json()["job"]
    p = box.start("fetch", str(job), "-o", "-", "--timeout", mark)
    p.stdout.read(1000)
    p.send_signal(signal.SIGKILL)
    p.wait()
    e2e.until(lambda: not far_end(mark), "fetch still runs on the remote side")
    d.ctl("fetch", str(job), "--format", "null").ok()
    p = box.start("watch", str(job), "--timeout", "60")
    p.wait(e2e.PATIENCE)
    waiting = subprocess.Popen([ACUTCTL, "mesh", "-", "--input-format", "xyz", "-o", "-", "--format", "obj"], stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=dict(os.environ, ACUT_SOCKET=d.socket))
    time.sleep(0.3)
    waiting.stdout.close()
    expect(waiting.wait(e2e.PATIENCE) == 141, "mesh whose reader is gone ended with %d" % waiting.returncode)
    waiting.stdin.close()
    waiting.stderr.close()


def all_of_it():
    with Folder() as base:
        with Daemon(base, memory="64M") as d:
            box = Box(base, d)
            try:
                if box.master.poll() is not None:
                    with open(base + "/ssh.log") as f:
                        e2e.unavailable("no ssh can be had: " + f.read().strip())
                got = box.run("ping")
                expect(got[0] == 0, "ping: %s" % (got,))
                for part in (both_ways, laz, statuses, cut_off):
                    begun = time.monotonic()
                    part(base, box, d)
                    print("     %-36s %6.1f s" % (part.__name__, time.monotonic() - begun), flush=True)
            finally:
                box.end()


if not SSHD or not shutil.which("ssh") or not shutil.which("ssh-keygen"):
    e2e.unavailable("openssh is not installed")
if os.getuid() == 0:
    try:
        os.makedirs(PRIVSEP, 0o755, exist_ok=True)  # and remains: another test may be using it
    except OSError as e:
        e2e.unavailable("%s: %s" % (PRIVSEP, e))
e2e.main(all_of_it)
