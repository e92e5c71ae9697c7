#!/usr/bin/env python3
"""scanner/usb on umockdev's bus: every byte that the device delivered comes once and in order, whatever the faults; a capture ends
exactly once; refusals say what to do."""
import os
import re
import signal
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../usb"))
import bus  # noqa: E402
from bus import Bus, device, expect, sha256, until  # noqa: E402
from rest import rests  # noqa: E402

TOOL = os.environ.get("USB_CAPTURE", "usb-capture")
KERNELS = [(k, p) for k in ("mock", "real") for p in ("fifo", "file")]
PROFILE = """title = test
[match]
vendor = 0x19a2
product = 0x5001
[usb]
interface = 0
endpoint-in = 0x81
%s
transfer-size = %s
transfers = %d
timeout = %s
%s
[framer]
kind = stream
[decoder]
name = xyz
"""
COMMANDS = """[start]
send = \\x02sEN LMDscandata 1\\x03
answer = \\x02sEA LMDscandata 1
[stop]
send = \\x02sEN LMDscandata 0\\x03
answer = \\x02sEA LMDscandata 0
"""


class Run(Bus):
    """The tool on a bus, with a profile made from PROFILE."""

    def tool(self, *args, commands="", size="64K", transfers=8, timeout=bus.PATIENCE, fail=None, wait=True):
        folder = self.path("profiles")
        os.makedirs(folder, exist_ok=True)
        with open(os.path.join(folder, "test.conf"), "w") as f:
            f.write(PROFILE % ("endpoint-out = 0x02" if commands else "", size, transfers, timeout, commands))
        p = self.start([TOOL, "--profile", os.path.join(folder, "test.conf"), "--out", self.path("out")] + list(args),
                       env={"ACUT_PROFILES": folder})
        return self.done(p, fail) if wait else p

    def done(self, p, fail=None):
        r = self.finish(p)
        r.counts = dict((k, int(v)) for k, v in re.findall(r"(\w+)=(\d+)", "".join(re.findall("^counts .*", r.out, re.M)[-1:])))
        r.events = [line.split(" ")[0] for line in r.out.splitlines()]
        if fail is None:
            expect(r.status == 0, "status %d: %s" % (r.status, r.err))
        else:
            expect(r.status == fail[0], "status %d, not %d: %s %s" % (r.status, fail[0], r.out, r.err))
            for text in fail[1:]:
                expect(text in r.err, "not told: %r in %r" % (text, r.err))
        return r

    def whole(self, r, i=0):
        m = r.model(i)
        expect(sha256(self.path("out")) == m["sha256"], "what came (%d bytes) is not what was given (%d): %s" %
               (os.path.getsize(self.path("out")), m["delivered"], r.out))
        expect(r.devices[i]["unreaped"] == 0, "transfers were not taken")
        expect(r.counts.get("bad_order", 0) == 0, "times go back")


def scanner(**words):
    return device(**dict({"id": "19a2:5001"}, **words))


def each_fault():
    # Faults that end transfers are further apart than the bytes in flight, so each is seen on its own.
    faults = ["at 1 MB stall", "at 1500000 short 100", "at 1600000 short 0", "at 2 MB babble 700", "at 3 MB error 512", "at 3200000 garbage 1000",
              "at 3300000 duplicate", "at 3400000 delay 0.1 s", "at 3500000 lose 1000", "at 4 MB stall", "at 4200000 stall", "at end stop"]
    for kernel, poll in KERNELS:
        with Run(scanner(source="pattern 5 MB", kernel=kernel, poll=poll, faults=faults)) as b:
            r = b.tool()
            b.whole(r)
            expect(r.counts["stalls"] == 3 and r.counts["overflows"] == 1 and r.counts["errors"] == 1, str(r.counts))
            expect(r.events.count("CLEARED") == 5 and r.events.count("GONE") == 1, r.out)
            expect(r.counts["after_gap"] == 2, r.out)


def caps():
    """The kernel lacks scatter-gather, and then more capabilities: transfers are cut into several."""
    for off in (8, 8 + 4, 8 + 4 + 2):
        with Run(scanner(source="pattern 3 MB", caps_off=off, faults=["at 1 MB stall", "at 1500000 short 5000", "at 2 MB error 100", "at end stop"])) as b:
            b.whole(b.tool())


def sizes():
    for size, transfers in (("512", 1), ("512", 64), ("1M", 2), ("16K", 32)):
        with Run(scanner(source="pattern 512 KB", message=3000, faults=["at 100 KB stall", "at end stop"])) as b:
            b.whole(b.tool(size=size, transfers=transfers))


STEPS = ["open", "claim", "submit", "submit 3", "submit 9", "submit 12", "reap", "reap 2", "reap 9", "clear", "discard", "discard 2", "release"]


def unplug_at_each_step():
    for kernel, poll in KERNELS:
        for step in STEPS:
            faults = ["at step %s unplug" % step, "at 1 MB stall", "at 4 MB stop"]
            with Run(scanner(source="pattern 8 MB", kernel=kernel, poll=poll, faults=faults)) as b:
                any_end(b)


def any_end(b, *args, **kw):
    """A run that may have started or not; its output fits that."""
    try:
        r = b.tool(*args, **kw)
    except bus.Fault as e:
        if "status" not in str(e):
            raise
        expect("unplugged" in str(e), "not told as unplugged: %s" % e)
        with open(b.path("report")) as f:
            import json
            r = type("R", (), {"report": json.load(f)})
        return r
    expect(r.events.count("GONE") == 1, r.out)
    b.whole(r)
    return r


def unplug_at_bytes():
    for i in range(12):
        kernel, poll = KERNELS[i % 4]
        faults = ["at %d unplug" % (i * 122468 + 1), "at 900 KB stall"]
        with Run(scanner(source="pattern 8 MB", kernel=kernel, poll=poll, faults=faults)) as b:
            r = any_end(b, size="16K")
            if hasattr(r, "out"):
                expect("GONE left" in r.out, r.out)


def replug():
    for kernel, poll in KERNELS:
        with Run(scanner(source="pattern 4 MB", kernel=kernel, poll=poll, faults=["at 1 MB unplug 0.1 s", "at 2 MB unplug 0.1 s", "at end stop"])) as b:
            r = b.tool("--again")
            b.whole(r)
            expect(r.events.count("started") == 3 and r.events.count("GONE") == 3, r.out)
            # A device that is looked at while the bus still adds it comes without its strings, leaves, and comes whole.
            seen = [e for e in r.events if e in ("CAME", "LEFT")]
            expect(len(seen) >= 4 and seen == ["LEFT", "CAME"] * (len(seen) // 2), r.out)


def commands():
    for kernel, poll in KERNELS:
        for size in ("512", "16K"):
            with Run(scanner(source="cola 300", on_command=True, kernel=kernel, poll=poll, faults=["at step start 3 stop", "at 100 KB stop"])) as b:
                r = b.tool(commands=COMMANDS, size=size)
                b.whole(r)
                expect(r.events.count("SENT") == 2 and r.counts["timeouts"] == 0, r.out)
                expect(r.model()["commands"] == 2, str(r.model()))


def no_answer():
    with Run(scanner(source="pattern 1 MB", on_command=True, faults=["at step start silent"])) as b:
        r = b.tool(commands=COMMANDS, timeout="2", fail=(124, "sEN LMDscandata 1", "0 bytes came", "2000 ms"))
        expect(r.devices[0]["releases"] == 1, "it was not released")
    with Run(scanner(source="pattern 1 KB", message=100)) as b:
        r = b.tool(commands=COMMANDS.replace("sEA", "sFA"), timeout="2", fail=(124, "bytes came: \""))
    with Run(scanner(source="pattern 1 MB", faults=["at step start refuse"])) as b:
        b.tool(commands=COMMANDS, fail=(74, "refused a command"))
    with Run(scanner(source="pattern 1 MB", faults=["at step start timeout"])) as b:
        b.tool(commands=COMMANDS, timeout="2", fail=(124, "did not take a command"))
    with Run(scanner(source="pattern 1 MB", on_command=True, faults=["at step start unplug"])) as b:
        b.tool(commands=COMMANDS, fail=(4, "unplugged while it was started"))
    with Run(scanner(source="pattern 1 MB", faults=["at step start unplug"])) as b:
        r = b.tool(commands=COMMANDS)
        b.whole(r)
        expect("GONE left" in r.out and r.model()["delivered"] > 0, r.out)
    with Run(scanner(source="cola 300", on_command=True, faults=["at step start 2 timeout", "at 100 KB stop"])) as b:
        r = b.tool(commands=COMMANDS, timeout="4") # the start must be answered within that
        b.whole(r)
        expect("TIMEOUT" in r.events and "GONE stopped" in r.out and "sEN LMDscandata 0" in r.out, r.out)


def stop_while_starting():
    with Run(scanner(source="pattern 1 KB", on_command=True, faults=["at step start silent", "at step start stop"])) as b:
        b.tool(commands=COMMANDS, timeout="600", fail=(1, "stopped while")) # or it waits, and has hung
    with Run(scanner(source="pattern 1 KB", faults=["at end stop"])) as b: # what has come is kept
        r = b.tool(commands=COMMANDS, timeout="600")
        b.whole(r)
        expect(r.model()["delivered"] == 1024 and "GONE stopped" in r.out, r.out)


def rights():
    with Run(scanner(locked=True)) as b:
        b.tool(fail=(77, 'ATTRS{idVendor}=="19a2"', 'ATTRS{idProduct}=="5001"', 'GROUP="acut-scan"', "/etc/udev/rules.d/"))


def drivers():
    """A driver of the kernel is detached from the profile's interface and attached again; others are left alone."""
    with Run(scanner(source="pattern 1 MB", driver="cdc_acm", faults=["at end stop"])) as b:
        r = b.tool()
        b.whole(r)
        expect(r.devices[0]["detaches"] == 1 and r.devices[0]["attaches"] == 1, str(r.devices[0]))
    with Run(scanner(source="pattern 1 MB", faults=["at end stop"])) as b:
        r = b.tool()
        expect(r.devices[0]["detaches"] == 0 and r.devices[0]["attaches"] == 0, "a driver was called that was not there")
    with Run(scanner(busy=True)) as b:
        r = b.tool(fail=(75, "interface 0 is in use by another program", "fuser -v /dev/bus/usb/"))


def without_udev():
    """No event announces the device: the list is polled. libusb does not list it: its node is opened."""
    for kernel in ("mock", "real"):
        with Run(udev=False) as b:
            b.script = scanner(source="pattern 1 MB", appear="with " + b.path("waits"), unheard=True, poll="file", kernel=kernel,
                               faults=["at 600 KB unplug"])
            r = b.tool("--wait", "--waits", b.path("waits"))
            b.whole(r)
            expect(r.events.count("CAME") == 1 and "GONE left" in r.out, r.out)


def dropped():
    """The capture is freed with all transfers in flight, nothing taken and nothing given back; then the context, with devices
    that come and go."""
    for kernel, poll in KERNELS:
        with Run(scanner(source="pattern 8 MB", kernel=kernel, poll=poll, faults=["every 1 MB stall"])) as b:
            b.tool("--bytes", "1500000", "--drop", "--hold", "2")
    with Run("".join(scanner(name="d%d" % i, port="1-%d" % (i + 1), appear="%d ms" % (20 * i)) for i in range(8))) as b:
        for ms in (30, 60, 90, 150):
            b.run([TOOL, "--watch", "%.3f" % (ms / 1000)])


def storage():
    with Run(scanner(**{"class": 8}) + device("b", id="1234:5678", port="1-2")) as b:
        r = b.tool("--device", "port:1-1", fail=(2, "mass storage"))
        d = r.devices[0]
        expect(d["opens"] + d["claims"] + d["detaches"] == 0, "mass storage was touched: %s" % d)
        b.tool("--device", "", fail=(4, "no scanner is plugged in"))
    with Run() as b:
        b.script = device("b", id="1234:5678", **{"class": 8, "appear": "with " + b.path("waits")})
        r = b.run([TOOL, "--watch", "600", "--changes", "1", "--waits", b.path("waits")])
        expect("CAME 1-1 1234:5678" in r.out and "storage=1" in r.out, "its coming was not told: %s" % r.out)
        expect(r.devices[0]["opens"] == 0, "mass storage was opened")


def listed_or_told():
    """Devices that came before the list was made are in it, and not announced again."""
    with Run() as b:
        b.script = scanner() + device("b", id="1234:5678", port="1-2", appear="with " + b.path("waits"))
        r = b.run([TOOL, "--list", "--wait", "--waits", b.path("waits")])
        expect(r.status == 0 and "\n1-2 1234:5678" in r.out and "CAME" not in r.out, r.out + r.err)


def which():
    two = scanner(name="a", serial="S1") + scanner(name="b", serial="S2", port="1-2", source="pattern 1 MB", faults=["at end stop"])
    with Run(two) as b:
        r = b.tool(fail=(2, "serial:S1", "serial:S2", "2 devices"))
        r = b.tool("--device", "serial:S2")
        b.whole(r, 1)
        r = b.tool("--device", "port:1-2")
        b.whole(r, 1)
        b.tool("--device", "19a2:5001", fail=(2, "serial:S1"))
        b.tool("--device", "test", fail=(2, "serial:S1"))
        b.tool("--device", "serial:S3", fail=(4, 'is "serial:S3"'))
        b.tool("--device", "tset", fail=(4, "no profile has that name"))
    with Run(scanner(name="a", serial="S1") + scanner(name="b", serial="S1", port="1-2")) as b:
        b.tool(fail=(2, "port:1-1", "port:1-2"))


def two_at_once():
    """One process captures two devices: each file has the bytes of its own device, also when the other one is unplugged."""
    for faults in ((), ("at %d unplug" % (64 << 10),)):
        with Run(scanner(name="a", serial="S1", source="pattern 2 MB") +
                 scanner(name="b", serial="S2", port="1-2", source="pattern 1 MB", seed=7, faults=list(faults))) as b:
            r = b.tool("--device", "serial:S1", "--second", "serial:S2", "--second-out", b.path("second"), "--bytes", str(1 << 20))
            b.whole(r, 0)
            expect(sha256(b.path("second")) == r.model(1)["sha256"], "the second device gave other bytes: %s" % r.out)
            expect(r.model(0)["sha256"] != r.model(1)["sha256"], "the devices gave the same")


def parked():
    """A slow receiver (it keeps each buffer until all others are full, and 2 ms more) gets all bytes, and transfers wait for
    it."""
    with Run(scanner(source="pattern 2 MB", faults=["at 1 MB stall", "at end stop"])) as b:
        r = b.tool("--slow", "2", size="16K", transfers=4)
        b.whole(r)
        expect(r.counts["parked"] > 100 and r.counts["parked_ns"] > 200e6, r.out)
        expect(r.events.count("PARKED") >= r.counts["parked"] - 1, r.out)
    with Run(scanner(source="pattern 256 KB", rate="1 MB", faults=["at end stop"])) as b: # less than transfers hold
        r = b.tool()
        b.whole(r)
        expect(r.counts["parked"] == 0 and r.counts["parked_ns"] == 0, "parked with nothing to do: %s" % r.out)


def half_filled():
    """The bytes of a transfer that is cancelled, by a stop or a stall, are data."""
    with Run(scanner(source="pattern 1 MB", rate="10 KB", faults=["at 3000 stall", "at %d stop" % (3000 + 2 * 512)])) as b:
        r = b.tool()
        b.whole(r)
        expect(r.counts["bytes"] > 3500 and r.counts["stalls"] == 1, r.out)


def not_given_back():
    with Run(scanner(source="pattern 4 MB")) as b:
        r = b.tool("--hold", "99", "--until-parked", transfers=4)
        b.whole(r)
        expect(r.counts["parked"] == 1 and 0 < r.counts["parked_ns"] < bus.HANG * 1e9, r.out)
        expect("GONE stopped" in r.out, r.out)
    with Run(scanner(source="cola 3000", on_command=True)) as b:
        r = b.tool("--hold", "99", "--until-parked", transfers=4, commands=COMMANDS)
        b.whole(r)
        expect(r.events.count("SENT") == 2 and r.counts["timeouts"] == 0, r.out)
    with Run(scanner(source="pattern 4 MB", faults=["at 200 KB unplug"])) as b:
        r = b.tool("--hold", "99", transfers=4)
        b.whole(r)


def memory():
    with Run(scanner(source="pattern 1 MB", faults=["at end stop"])) as b:
        b.tool("--memory", "1", size="256K", fail=(1, "8 transfers of 262144 bytes need", "1048576", "usbfs_memory_mb=1", "echo 3 >"))
        b.tool(size="1M", transfers=16, fail=(1, "usbfs_memory_mb=16, assumed"))
        b.whole(b.tool("--memory", "0", size="1M", transfers=16))
        b.whole(b.tool("--memory", "1", size="64K"))


def misfit():
    with Run(scanner(source="pattern 1 MB", packet=1024)) as b:
        b.tool(size="512", fail=(1, "no multiple of the endpoint's packet"))


def idle():
    with Run(scanner(source="pattern 1 KB")) as b:
        p = b.tool(wait=False)
        until(lambda: os.path.exists(b.path("out")) and os.path.getsize(b.path("out")) == 1024, "it did not come")
        pid = b.program(p, TOOL)
        rests(pid, 40, 0.04)
        os.kill(pid, signal.SIGINT)
        b.whole(b.done(p))


CASES = [each_fault, caps, sizes, unplug_at_each_step, unplug_at_bytes, replug, commands, no_answer, stop_while_starting, rights, drivers, without_udev, dropped, storage, listed_or_told, which, two_at_once,
         parked, half_filled, not_given_back, memory, misfit, idle]

if __name__ == "__main__":
    bus.need()
    sys.exit(bus.run_cases(CASES, sys.argv[1:]))
