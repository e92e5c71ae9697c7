"""Shared by the end-to-end tests: temporary folders, private daemons, runs of the programs. meson sets the paths of the programs
(ACUTD, ACUTCTL, ACUT_SYNTH, ACUT_VERIFY, ACUT_DOMAIN). A test prints a line for each case. Its exit status is 0, 1, or 77
(skipped, with the reason)."""
import contextlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback

ACUTD = os.environ.get("ACUTD", "acutd")
ACUTCTL = os.environ.get("ACUTCTL", "acutctl")
SYNTH = os.environ.get("ACUT_SYNTH", "acut-synth")
VERIFY = os.environ.get("ACUT_VERIFY", "acut-verify")
DOMAIN = os.environ.get("ACUT_DOMAIN", "acut-domain")
GATE = os.environ.get("ACUT_TEST_GATE")
# How long anything may take before the test says that it hangs. No test compares with it, and none waits for it where all is well.
PATIENCE = 240
# meson has malloc fill each block, which is for programs of one room. Filling all memory that daemons may use takes most of the time
# of a test; those with ACUT_TEST_FILL in their meson.build keep it.
if not os.environ.get("ACUT_TEST_FILL"):
    os.environ["MALLOC_PERTURB_"] = "0"
# A program in the background may inherit that these signals are ignored; programs of the tests must get them.
for _sig in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT):
    if signal.getsignal(_sig) == signal.SIG_IGN:
        signal.signal(_sig, signal.default_int_handler if _sig == signal.SIGINT else signal.SIG_DFL)


def skip(reason):
    print("skipped:", reason)
    sys.exit(77)


def unavailable(reason):
    """Something that this machine lacks or does not permit: the test is skipped; it fails where .ci/run has found that the
    machine has it."""
    if os.environ.get("ACUT_TEST_PRIVILEGED"):
        print("FAIL: would be skipped, and must run here:", reason)
        sys.exit(1)
    skip(reason)


def polygon(path, reach):
    """Corners of a strictly convex polygon: its sides are all primitive vectors with coordinates up to `reach`, by direction."""
    span = range(-reach, reach + 1)
    sides = sorted(((p, q) for p in span for q in span if math.gcd(p, q) == 1), key=lambda side: math.atan2(side[1], side[0]))
    x = y = 0
    with open(path, "w") as f:
        for i, (p, q) in enumerate(sides):
            f.write("%d %d %d\n" % (x, y, i % 17))
            x, y = x + p, y + q
    return len(sides)


def data_dir():
    """The folder of real files, or None."""
    here = os.path.dirname(os.path.abspath(__file__))
    for path in (os.environ.get("ACUT_TEST_DATA"), os.path.join(here, "../../../shared/data")):
        if path and os.path.isdir(os.path.join(path, "lidar")):
            return os.path.abspath(path)
    return None


class Fault(AssertionError):
    pass


def expect(cond, text):
    if not cond:
        raise Fault(text)


class Run:
    """A finished command."""

    def __init__(self, args, status, out, err):
        self.args, self.status, self.out, self.err = args, status, out, err

    def json(self):
        return json.loads(self.out)

    def ok(self):
        expect(self.status == 0, "%s\nended with %d\n%s%s" % (" ".join(self.args), self.status, self.out, self.err))
        return self


def run(args, env=None, timeout=600, stdin=None):
    full = dict(os.environ)
    full.update(env or {})
    p = subprocess.run([str(a) for a in args], stdin=stdin or subprocess.DEVNULL, stdout=subprocess.PIPE,
                       stderr=subprocess.PIPE, env=full, timeout=timeout)
    return Run([str(a) for a in args], p.returncode, p.stdout.decode(errors="replace"),
               p.stderr.decode(errors="replace"))


class Folder:
    """A temporary folder: with Folder() as path."""

    PREFIX = "acut-e2e-"

    def __enter__(self):
        self.path = tempfile.mkdtemp(prefix=self.PREFIX, dir=os.environ.get("ACUT_TEST_TMP"))
        return self.path

    def __exit__(self, *exc):
        shutil.rmtree(self.path, ignore_errors=True)


def end_daemons(base):
    """Kills processes of acutd with folders below `base` (private daemons would stay idle for a while)."""
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open("/proc/%s/cmdline" % pid, "rb") as f:
                words = f.read().decode(errors="replace").split("\0")
        except OSError:
            continue
        if os.path.basename(words[0]) == "acutd" and any(w.startswith(base) for w in words):
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)


def lose_domains(d):
    """Removes all stored domains of a daemon that runs, and may write some, and make the folder itself."""
    folder = os.path.join(d.cache, "domains")
    until(lambda: run(["rm", "-rf", folder]).status == 0, "acutd writes all the time")
    os.makedirs(folder, exist_ok=True)


def resident(pid):
    """Bytes that are resident. Other files of /proc have it without the last pages of each processor, and this one is not everywhere."""
    try:
        with open("/proc/%d/smaps_rollup" % pid) as f:
            return next(int(line.split()[1]) for line in f if line.startswith("Rss:")) << 10
    except OSError:
        with open("/proc/%d/statm" % pid) as f:
            return int(f.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def files_of(pid):
    """The paths of the descriptors that a process has open, in order, and without those that it closes meanwhile."""
    folder, found = "/proc/%d/fd/" % pid, []
    for n in os.listdir(folder):
        try:
            found.append(os.readlink(folder + n))
        except FileNotFoundError:
            pass
    return sorted(found)


def sanitized():
    """True if acutd was built with a sanitizer: its memory is then not the product's."""
    try:
        with open(ACUTD, "rb") as f:
            data = f.read()
    except OSError:
        return False
    return b"__asan_init" in data or b"__tsan_init" in data


def until(cond, text, every=0.02):
    """Waits for the first true value of cond() and returns it; fails after PATIENCE with `text` (a string, or a function that
    makes it)."""
    deadline = time.monotonic() + PATIENCE
    while True:
        got = cond()
        if got:
            return got
        expect(time.monotonic() < deadline, text if isinstance(text, str) else text())
        time.sleep(every)


def cpu_of(pid):
    """Seconds of CPU time that it has used, which other programs do not lengthen."""
    with open("/proc/%d/stat" % pid) as f:
        fields = f.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def worked(end, p):
    """Calls end(), in which the process p ends and is waited for; returns what that returns, and the seconds of CPU time that p
    used meanwhile."""
    before, children = cpu_of(p.pid), os.times()
    got, now = end(), os.times()
    return got, now.children_user + now.children_system - children.children_user - children.children_system - before


def handles(p, sig):
    """Waits until the program of a process handles the signal, which would kill it before."""
    def caught():
        with open("/proc/%d/status" % p.pid) as f:
            return int(next(line for line in f if line.startswith("SigCgt:")).split()[1], 16) >> sig - 1 & 1
    until(lambda: p.poll() is not None or caught(), "it does not handle signal %d" % sig, 0.002)


class Gate:
    """Holds calls of a program: Gate(base) as gate; Daemon(base, env=gate.env). gate.close("pread", ".seg", 3) lets three reads
    of a file of such a path go by and holds all others, gate.wait() waits until one is held, gate.open() lets all go on."""

    def __init__(self, base):
        if not GATE:
            raise Fault("ACUT_TEST_GATE names no library: the tests are run by meson")
        self.folder, self.n = tempfile.mkdtemp(prefix="gate-", dir=base), 0
        os.chmod(self.folder, 0o777)
        self.env = {"LD_PRELOAD": GATE, "ACUT_GATE": self.folder}
        if sanitized():
            self.env["ASAN_OPTIONS"] = (os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0").lstrip(":")

    def path(self, name):
        return os.path.join(self.folder, name)

    def close(self, call, text, first=0, program="*"):
        """From now on. `first`: how many go by. `program`: "acutctl", where its acutd has the same environment. Whoever is held by an earlier rule and is meant by this one is counted anew."""
        self.n += 1
        if os.path.exists(self.path("held")):
            os.unlink(self.path("held"))
        with open(self.path("new"), "w") as f:
            f.write("%s %s %d %d %s" % (call, text, first, self.n, program))
        os.rename(self.path("new"), self.path("rule"))

    def wait(self, other=lambda: False):
        """Waits until a call is held, and returns True; or until other() is true, and returns False."""
        return until(lambda: (2 if os.path.exists(self.path("held")) else 0) or (1 if other() else 0), "nobody comes to the gate", 0.005) == 2

    def open(self):
        if os.path.exists(self.path("rule")):
            os.unlink(self.path("rule"))


class Daemon:
    """An acutd with folders of its own below `base`; with Daemon(base) as d: d.ctl("ping")."""

    def __init__(self, base, memory="256M", threads=2, args=(), prefix=(), env=None, name=""):
        self.base = base
        self.socket = os.path.join(base, "acutd%s.sock" % name)
        self.state, self.cache = os.path.join(base, "state" + name), os.path.join(base, "cache" + name)
        self.log = os.path.join(base, "acutd%s.log" % name)
        self.command = list(prefix) + [ACUTD, "--no-config", "--socket", self.socket, "--init", "--state", self.state, "--cache", self.cache,
                                       "--memory", memory, "--threads", str(threads)] + list(args)
        self.env = dict(os.environ)
        self.env.update(env or {})
        self.process = None

    def start(self):
        log = open(self.log, "ab")
        if os.environ.get("ACUT_UNIT_DAEMON") and self.command[0] == ACUTD:
            import unit_daemon
            self.process = unit_daemon.Process(self)
        else:
            self.process = subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self.env)
        log.close()
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                raise Fault("acutd ended with %d\n%s" % (self.process.returncode, self.log_text()))
            if os.path.exists(self.socket) and self.ctl("ping").status == 0:
                return self
            time.sleep(0.02)
        raise Fault("acutd did not answer\n" + self.log_text())

    def log_text(self):
        with open(self.log, errors="replace") as f:
            return f.read()

    def ctl(self, *args, **kw):
        env = dict(kw.pop("env", None) or {})
        env["ACUT_SOCKET"] = self.socket
        return run([ACUTCTL] + list(args), env=env, **kw)

    def vmhwm(self):
        """Peak resident bytes; 0 under a sanitizer."""
        if sanitized():
            return 0
        with open("/proc/%d/status" % self.process.pid) as f:
            for line in f:
                if line.startswith("VmHWM:"):
                    return int(line.split()[1]) * 1024
        return 0

    def stop(self, sig=signal.SIGTERM, timeout=PATIENCE):
        if self.process and self.process.poll() is None:
            self.process.send_signal(sig)
            try:
                self.process.wait(timeout)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                raise Fault("acutd did not end within %d s of signal %d" % (timeout, sig))
        return self.process.returncode if self.process else None

    def __enter__(self):
        return self.start()

    def __exit__(self, *exc):
        if exc[0] is not None:
            print(self.log_text()[-4000:])
        self.stop(signal.SIGKILL)


def where(e):
    """The lines of the test that raised an error, the innermost last, without those of this file."""
    frames = [f for f in traceback.extract_tb(e.__traceback__) if f.filename != __file__]
    return "\n".join("  at %s, line %d, in %s: %s" % (os.path.basename(f.filename), f.lineno, f.name, f.line) for f in frames)


def passes(case):
    start = time.monotonic()
    try:
        case()
        print("ok   %-40s %6.1f s" % (case.__name__, time.monotonic() - start), flush=True)
        return True
    except Exception as e:
        print("FAIL %-40s %6.1f s\n%s: %s\n%s" % (case.__name__, time.monotonic() - start, type(e).__name__, e, where(e)), flush=True)
        return False


def main(*cases, at_once=1):
    """Runs all cases in order; each is a function. `at_once`: in processes of their own, as many beside each other, for cases that mostly
    wait. The exit status tells whether one failed or, if none did, whether one was skipped."""
    if at_once == 1:
        sys.exit(0 if all([passes(case) for case in cases]) else 1)
    left, running, ends = list(cases), {}, set()
    while left or running:
        if left and len(running) < at_once:
            sys.stdout.flush()
            case = left.pop(0)
            pid = os.fork()
            if not pid:
                try:
                    status = 0 if passes(case) else 1
                except SystemExit as end:
                    status = end.code
                sys.stdout.flush()
                os._exit(status)
            running[pid] = case.__name__
        else:
            pid, status = os.wait()
            name, end = running.pop(pid), os.waitstatus_to_exitcode(status)
            if end == 77:
                print("skip %s" % name, flush=True)
            elif end not in (0, 1):
                print("FAIL %s: ended with %s" % (name, "signal %d" % -end if end < 0 else "status %d" % end), flush=True)
            ends.add(end)
    sys.exit(1 if ends - {0, 77} else max(ends))
