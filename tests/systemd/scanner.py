"""The capture unit in a running systemd (in a container without USB; tests/vm has USB). acut-scan works in its sandbox, captures
all bytes, and without a device fails soon with a message."""
import json
import os
import stat
import subprocess
import sys
import time

sys.path[:0] = ["/opt/acut/tree/tests/e2e", "/opt/acut/tree/tests/usb"]
import e2e
from e2e import Fault, expect, main, run
from spool import Spool

UNIT = "/usr/local/lib/systemd/system/acut-scan@.service"
SPOOLS = "/var/lib/acut-scan"
PORT = "port:%i"


def systemctl(*args, timeout=e2e.PATIENCE):
    return run(["systemctl", "--no-pager"] + list(args), timeout=timeout)


def show(prop, unit):
    return systemctl("show", "-P", prop, unit).ok().out.strip()


def journal(unit):
    run(["journalctl", "--sync"])
    return run(["journalctl", "--no-pager", "-o", "cat", "-b", "-u", unit]).out


def until(what, seconds=e2e.PATIENCE):
    deadline = time.monotonic() + seconds
    while not what():
        if time.monotonic() > deadline:
            raise Fault("not within %d s: %s\n%s" % (seconds, what.__name__, systemctl("status", "acut-test-*").out))
        time.sleep(0.02)


class Copy:
    """The shipped unit under another name, bound to no device, with another source of bytes and the same permissions."""

    def __init__(self, name, source):
        self.unit, self.source = "acut-test-%s.service" % name, source

    def __enter__(self):
        with open(UNIT) as f:
            text = f.read()
        lines = [line for line in text.splitlines() if not line.startswith(("BindsTo=", "After="))]
        # It is not started again before its end was looked at.
        text = "\n".join(lines).replace("--device " + PORT, self.source).replace("RestartSec=1s", "RestartSec=300s")
        expect(self.source in text and "RestartSec=300s" in text, "the unit is not as this test takes it to be")
        with open("/run/systemd/system/" + self.unit, "w") as f:
            f.write(text + "\n")
        systemctl("daemon-reload").ok()
        return self.unit

    def __exit__(self, *exc):
        systemctl("kill", "-s", "KILL", self.unit)
        systemctl("stop", self.unit)
        os.unlink("/run/systemd/system/" + self.unit)
        systemctl("daemon-reload").ok()
        systemctl("reset-failed")


def spools():
    return sorted(os.path.join(SPOOLS, n) for n in os.listdir(SPOOLS)) if os.path.isdir(SPOOLS) else []


def captures_within_its_sandbox():
    data = os.urandom(5 << 20)
    os.makedirs("/run/acut-scanner-test", exist_ok=True)
    path = "/run/acut-scanner-test/pipe"
    os.mkfifo(path, 0o644)
    subprocess.run(["chown", "acut-scan", path], check=True)
    with Copy("pipe", "--from " + path) as unit:
        starting = subprocess.Popen(["systemctl", "start", unit])
        writer = os.open(path, os.O_WRONLY)
        expect(starting.wait(e2e.PATIENCE) == 0, "it is not started once it captures:\n" + journal(unit))
        expect(show("ActiveState", unit) == "active", journal(unit))
        pid = show("MainPID", unit)
        with open("/proc/%s/status" % pid) as f:
            status = dict(line.rstrip("\n").split(":\t", 1) for line in f if ":\t" in line)
        user = run(["id", "-u", "acut-scan"]).out.strip()
        expect(status["Uid"].split() == [user] * 4 and user != "0", "user %s" % status["Uid"])
        for which in ("CapBnd", "CapEff", "CapPrm", "CapAmb"):
            expect(int(status[which], 16) == 0, "%s %s" % (which, status[which]))
        expect(status["NoNewPrivs"] == "1" and status["Seccomp"] == "2", "seccomp %s" % status["Seccomp"])
        expect(os.readlink("/proc/%s/ns/net" % pid) == os.readlink("/proc/self/ns/net"), "udev's events do not come into a network of its own")
        half = len(data) // 2
        view = memoryview(data)
        for part in (view[:half], view[half:]):
            while part:
                part = part[os.write(writer, part):]
        until(lambda: spools() and os.path.getsize(spools()[0]) >= len(data))
        # After a stop the spool has its END, and the unit has not failed.
        begun = time.monotonic()
        systemctl("stop", unit).ok()
        print("     stop of a capture: %.2f s" % (time.monotonic() - begun))
        os.close(writer)
        expect(show("Result", unit) == "success", show("Result", unit) + "\n" + journal(unit))
    spool, = spools()
    s = Spool(spool)
    expect(s.bytes() == data, "%d bytes of %d" % (len(s.bytes()), len(data)))
    expect(s.end and s.events()[-1] == "stop signal", str(s.events()))
    with open("/proc/sys/kernel/random/boot_id") as f:
        expect(s.boot == f.read().strip(), "the boot id is %r" % s.boot)
    folder, file = os.stat(SPOOLS), os.stat(spool)
    expect(stat.S_IMODE(folder.st_mode) == 0o2750 and folder.st_uid == int(user), "%s: %o" % (SPOOLS, folder.st_mode))
    expect(stat.S_IMODE(file.st_mode) == 0o640 and file.st_gid == folder.st_gid, "%s: %o" % (spool, file.st_mode))


def without_a_device():
    """A start without a device fails with a message, and is not repeated for ever."""
    begun = time.monotonic()
    got = systemctl("start", "acut-scan@9-9.service")
    took = time.monotonic() - begun
    expect(got.status != 0, "it runs without a device")
    expect(show("JobTimeoutUSec", "acut-scan@9-9.service") == "15s", "told after " + show("JobTimeoutUSec", "acut-scan@9-9.service"))
    print("     %.1f s: %s" % (took, got.err.strip().splitlines()[0]))
    # The program itself, in the same sandbox, bound to no device.
    with Copy("none", "--device port:9-9") as unit:
        systemctl("start", unit)
        text = journal(unit)
        expect(show("Result", unit) == "exit-code" and show("NRestarts", unit) == "0", show("Result", unit) + text)
        expect("9-9" in text and "plugged in" in text, text)
        expect("SIGSYS" not in text and "core-dump" not in text, text)


def spools_go_into_a_dataset():
    """The example service of a timer, as installed: each spool once; not yet those that are still written to or have no poses."""
    examples = "/usr/local/share/doc/acut-scanner/examples/"
    with open(examples + "acut-scan-push.service") as f:
        text = f.read().replace("/usr/local/lib/acut/", examples)

    def pushed(settle, poses):
        with open("/run/systemd/system/acut-scan-push.service", "w") as f:
            f.write(text.replace("POSES=/srv/poses", "POSES=%s SETTLE_MINUTES=%d" % (poses, settle)))
        systemctl("daemon-reload").ok()
        expect(systemctl("start", "acut-scan-push.service").status == 0, journal("acut-scan-push.service"))
        lines = run([e2e.ACUTCTL, "datasets", "--json"], timeout=e2e.PATIENCE).ok().out.splitlines()
        return {d["name"]: (d["points"], d["generation"]) for d in map(json.loads, lines)}

    for path in spools():
        os.unlink(path)
    systemctl("start", "acutd.socket").ok()
    run([e2e.SYNTH, "--points", "20000", "/srv/field.las"]).ok()
    run(["runuser", "-u", "acut-scan", "--", "acut-scan", "record", "--from", "/srv/field.las", "--profile", "generic-las", "--folder",
         SPOOLS, "--quiet"], timeout=e2e.PATIENCE).ok()
    expect(pushed(5, "-") == {}, "a spool that was written to just now is taken")
    os.makedirs("/srv/poses", exist_ok=True)
    expect(pushed(0, "/srv/poses") == {}, "a spool without poses is taken")
    first = pushed(0, "-")
    expect(first["survey"][0] == 20000, str(first))
    expect(pushed(0, "-") == first, "it was pushed again")
    run(["rm", "-r", "/var/lib/acut-scan-push"]).ok()
    expect(pushed(0, "-") == first, "without its mark it was doubled")
    expect(len(spools()) == 1, "the spool is gone")


main(captures_within_its_sandbox, without_a_device, spools_go_into_a_dataset)
