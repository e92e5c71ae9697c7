"""Shared by the tests of scanners: a script of devices, a program that runs on their bus, and its report.

meson sets FAKE_USB, PLAIN_CAPTURE, ACUT_SCAN and ACUT_PROFILES. With ACUT_TEST_PRIVILEGED, a test that would be skipped fails
(tests/e2e/e2e.py). A program with sanitizers gets the options that they need beside umockdev's preload.
"""
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../e2e"))
from e2e import Fault, expect, unavailable, until  # noqa: E402
from rest import children  # noqa: E402

FAKE_USB = os.environ.get("FAKE_USB", "fake-usb")
PLAIN = os.environ.get("PLAIN_CAPTURE", "plain-capture")
SCAN = os.environ.get("ACUT_SCAN", "acut-scan")
PROFILES = os.environ.get("ACUT_PROFILES")
HANG = float(os.environ.get("ACUT_TEST_HANG", "180"))  # seconds after which a program is taken as hung
PATIENCE = 60  # seconds for commands and answers in tests that do not test time limits
MB = 1 << 20


def sanitizer(program):
    """Which sanitizer a program was built with: "address", "thread" or None."""
    with open(program, "rb") as f:
        data = f.read()
    return "address" if b"__asan_init" in data else "thread" if b"__tsan_init" in data else None


def sanitized_env(program):
    """The options that a sanitizer needs beside a preload; nothing is suppressed. It reports to stderr: with log_path it would
    call open before the preload is ready, and the program would die or see no bus."""
    env = {}
    kind = sanitizer(program)
    if kind == "address":
        env["ASAN_OPTIONS"] = "verify_asan_link_order=0:detect_leaks=1:exitcode=66"
        env["UBSAN_OPTIONS"] = "halt_on_error=1:print_stacktrace=1:exitcode=66"
    elif kind == "thread":
        env["TSAN_OPTIONS"] = "exitcode=66:halt_on_error=0"
    return env


def patient_profiles(folder):
    """The shipped profiles with longer timeouts, for a machine that is busy."""
    os.makedirs(folder, exist_ok=True)
    for name in os.listdir(PROFILES):
        if name.endswith(".conf"):
            with open(os.path.join(PROFILES, name)) as f, open(os.path.join(folder, name), "w") as out:
                out.write(patient(f.read()))
    return folder


def patient(profile):
    return re.sub(r"^timeout = .*$", "timeout = %d" % PATIENCE, profile, flags=re.M)


def need():
    """Ends the test where there is no umockdev to run it."""
    if not shutil.which("umockdev-wrapper"):
        unavailable("no umockdev-wrapper (package umockdev)")
    if not os.path.exists(FAKE_USB):
        unavailable("fake-usb was not built (package libumockdev-dev)")


class Bus:
    """A folder with a script; run() runs a program on it."""

    def __init__(self, script="", udev=True):
        self.udev = udev
        self.dir = tempfile.mkdtemp(prefix="acut-usb-")
        self.script = script
        self.runs = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        shutil.rmtree(self.dir, ignore_errors=True)

    def path(self, name):
        return os.path.join(self.dir, name)

    def start(self, args, timeout=HANG, env=None, **kw):
        self.runs += 1
        with open(self.path("script"), "w") as f:
            f.write(self.script)
        full = dict(os.environ)
        full.update(sanitized_env(args[0]))
        full.update(env or {})
        command = ["umockdev-wrapper", FAKE_USB, "--timeout", str(timeout), "--report", self.path("report")]
        command += (["--udev"] if self.udev else []) + [self.path("script"), "--"] + args
        return subprocess.Popen(command, env=full, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, cwd=self.dir, **kw)

    def program(self, process, args0):
        """The pid of the program that runs on the bus."""
        def find():
            for pid in children(process.pid):
                try:
                    with open("/proc/%d/cmdline" % pid, "rb") as f:
                        if f.read().split(b"\0")[0].decode() == args0:
                            return pid
                except OSError:
                    pass
            expect(process.poll() is None, "it has ended: %s" % (process.poll() is not None and process.communicate()[1]))
            return None
        return until(find, "%s does not run" % args0)

    def finish(self, process, timeout=HANG):
        try:
            out, err = process.communicate(timeout=timeout + 30)
        except subprocess.TimeoutExpired:
            process.kill()
            raise Fault("fake-usb itself hung")
        return Result(self, process.returncode, out, err)

    def run(self, args, timeout=HANG, env=None):
        return self.finish(self.start(args, timeout, env), timeout)


class Result:
    def __init__(self, bus, status, out, err):
        self.status, self.out, self.err = status, out, err
        try:
            with open(bus.path("report")) as f:
                self.report = json.load(f)
        except (OSError, ValueError):
            raise Fault("no report: %s %s" % (out[-500:], err[-2000:]))
        self.devices = self.report["devices"]
        found = re.search("Sanitizer:|runtime error:", err)
        self.sanitizer = err[max(0, found.start() - 100):] if found else ""
        expect(not self.report["hung"], "it hung: %s" % err[-3000:])
        expect(not self.sanitizer, "a sanitizer says:\n" + self.sanitizer[:6000])
        expect(self.report["signal"] not in (4, 6, 7, 8, 11), "it died of signal %s: %s" % (self.report["signal"], err[-3000:]))

    def model(self, i=0):
        return self.devices[i]["model"]


def device(name="a", **words):
    """Lines of a script for one device. `faults` is a list of lines; the other words are lines `key value` (an underscore becomes
    a dash; True: the key alone)."""
    lines = ["device " + name]
    faults = words.pop("faults", [])
    for key, value in words.items():
        key = key.replace("_", "-")
        lines.append(key if value is True else "%s %s" % (key, value))
    return "\n".join(lines + list(faults)) + "\n"


def sha256(path):
    h = hashlib.sha256()
    with open(path, "rb") as f:
        for piece in iter(lambda: f.read(1 << 20), b""):
            h.update(piece)
    return h.hexdigest()


def source_bytes(script, path):
    """The bytes of the first device's source, without faults."""
    with open(path + ".script", "w") as f:
        f.write(script)
    subprocess.run([FAKE_USB, "--source", path + ".script", path], check=True, timeout=HANG)
    with open(path, "rb") as f:
        return f.read()


def run_cases(cases, wanted):
    """Runs the cases, or those that are `wanted` by name. Prints a line for each."""
    failed = 0
    for case in cases:
        name = case.__name__
        if wanted and name not in wanted:
            continue
        start = time.monotonic()
        try:
            case()
            print("ok   %-30s %6.1f s" % (name, time.monotonic() - start), flush=True)
        except (Fault, OSError, ValueError, KeyError, IndexError, subprocess.TimeoutExpired) as e:
            failed += 1
            print("FAIL %-30s %6.1f s: %s: %s" % (name, time.monotonic() - start, type(e).__name__, e), flush=True)
    return 1 if failed else 0
