#!/usr/bin/env python3
"""acut-scan record on a faulty bus: the spool has exactly the bytes that the device delivered."""
import os
import random
import signal
import sys

import bus
from bus import Bus, device, expect, until
from spool import Spool

PROFILE = """title = a stream of bytes
[match]
vendor = 0x1209
product = 0x0001
[usb]
interface = 0
endpoint-in = 0x81
endpoint-out = 0x02
transfer-size = %s
transfers = %d
timeout = %d
%s
[framer]
kind = stream
[decoder]
name = raw
"""


def record(b, *more, size="64K", transfers=8, commands="", patience=bus.PATIENCE, timeout=None, wait=True, out="out.spool"):
    os.makedirs(b.path("profiles"), exist_ok=True)
    with open(b.path("profiles/bulk.conf"), "w") as f:
        f.write(PROFILE % (size, transfers, patience, commands))
    args = [bus.SCAN, "record", "--profiles", b.path("profiles"), "-o", b.path(out), "--no-progress"] + list(more)
    return b.run(args, timeout or bus.HANG) if wait else b.start(args, timeout or bus.HANG)


def whole(b, r, ended=True, gaps=True):
    """The spool has the bytes that the model delivered and marks where bytes are missing; no bytes were left in the kernel."""
    s, m, d = Spool(b.path("out.spool")), r.model(), r.devices[0]
    expect(s.sha256() == m["sha256"],
           "%d bytes in the spool, %d were given: %s; events %s; %s" % (len(s.bytes()), m["delivered"], m["rows"][:6], s.events()[:20], r.err))
    expect(s.torn == 0, "%d bytes are torn" % s.torn)
    expect(bool(s.end) == ended, "END: %s; %s" % (s.end, s.events()))
    expect(not ended or s.events()[-1].split()[0] == "stop" and len(s.events()[-1].split()) == 2, "it does not say why it ended: %s" % s.events()[-1])
    expect(d["unreaped"] == 0, "%d bytes were not taken from the kernel" % d["unreaped"])
    expect(d["detaches"] == 0 and d["refused"] == 0, "the kernel was asked for odd things: %s" % d)
    if gaps:
        lost = [row["delivered"] for row in m["rows"] if row["lost"] and row["verb"] in ("babble", "error")]
        missing = [p for p in lost if p < m["delivered"] and p not in s.gaps()]
        expect(not missing, "no gap is told at %s, only at %s" % (missing, s.gaps()))
    return s, m


LONG = bool(os.environ.get("ACUT_USB_LONG"))


def kernels(i):
    """Both ways in which an unplug looks to the program; one of them, in turns, unless ACUT_USB_LONG is set."""
    return ("mock", "real") if LONG else (("mock", "real")[i % 2],)


# ---- one fault at a time ----

ONE = [
    ("nothing", [], []),
    ("stall", ["at 1 MB stall"], ["stall", "cleared"]),
    ("stalls", ["every 200 KB stall"], ["stall", "cleared"]),
    ("stall at once", ["at 0 stall"], ["stall", "cleared"]),
    ("stall in a transfer", ["at 1000000 stall"], ["stall", "cleared"]),
    ("short", ["at 1 MB short 100"], []),
    ("empty", ["at 1 MB short 0", "at 1500000 short 0"], []),
    ("babble", ["at 1 MB babble 700"], ["overflow", "cleared"]),
    ("babble in a transfer", ["at 1000448 babble 1"], ["overflow", "cleared"]),
    ("error", ["at 1000448 error 512"], ["error", "cleared"]),
    ("not taken", ["at step submit 12 deny"], ["error", "cleared"]),
    ("silence", ["at 1 MB delay 0.4 s"], []),
    ("duplicate", ["at 1 MB duplicate 512"], []),
    ("garbage", ["at 1 MB garbage 1000"], []),
    ("lost in the device", ["at 1 MB lose 5000"], []),
    ("stopped at full speed", ["at 1000000 stop"], []),
    ("silent", ["at 1 MB silent", "at step submit 30 stop"], []),
]


def each_fault():
    for i, (name, faults, words) in enumerate(ONE):
        for kernel in kernels(i):
            with Bus(device(source="pattern 2 MB", kernel=kernel, faults=faults + ["at end stop"])) as b:
                if name == "silent":
                    r = record(b, "--for", "1")
                else:
                    r = record(b)
                expect(r.report["status"] == 0, "%s: status %s: %s" % (name, r.report["status"], r.err))
                s, m = whole(b, r)
                expect(all(w in s.words() for w in words), "%s: events are %s" % (name, s.events()))
                expect(name in ("silent", "stopped at full speed") or all(f["fired"] for f in m["faults"]), "%s did not happen: %s" % (name, m["faults"]))


def stopped_in_a_transfer():
    """Bytes of full and half-filled transfers that are cancelled by a stop."""
    for i, rate in enumerate(("3 MB", "20 MB", "40 MB")):
        for kernel in kernels(i):
            with Bus(device(source="pattern 64 MB", rate=rate, kernel=kernel, faults=["at 500300 stop"])) as b:
                r = record(b)
                s, m = whole(b, r)
                expect(r.report["status"] == 0 and m["delivered"] < 64 << 20, "it did not stop: %s" % m["delivered"])


STOPS = [ # and how many commands the device has taken then: of each that it was started by there is one that stops it
    (["at 300000 stop"], (2,)), (["at step start stop"], (2,)), (["at step open stop"], (0, 2)), (["at 300000 stop", "at step start 2 unplug"], (1,)),
    (["at 300000 stop", "at step start 2 refuse"], (1,)), (["at 300000 stall", "at step clear stop"], (2,)), (["at 300000 unplug", "at 300000 stop"], (1,)),
    (["at 300000 unplug 0.1 s", "at step open 2 stop"], (1, 3)), (["at 300000 unplug 0.1 s", "at step start 2 stop"], (3,)),
]


def stopped_at_any_time():
    """A stop, also during a start, a return or a stop, ends well, and a started scanner gets its stop command."""
    for i, (faults, commands) in enumerate(STOPS):
        for kernel in kernels(i):
            back = ["--reconnect"] if any("0.1 s" in f for f in faults) else []
            with Bus(device(source="pattern 8 MB", kernel=kernel, on_command=True, faults=faults)) as b:
                r = record(b, *back, commands=COMMAND)
                m, name = r.model(), "%s %s" % (kernel, faults)
                expect(r.report["status"] in ((0,) if back or "unplug" not in faults[0] else (0, 3)), "%s: status %s: %s" % (name, r.report["status"], r.err))
                expect(m["commands"] in commands, "%s: %d commands" % (name, m["commands"]))
                if os.path.exists(b.path("out.spool")):
                    whole(b, r, gaps=False)
                else:
                    expect(not m["delivered"], "%s: no spool of %d bytes" % (name, m["delivered"]))


TWO = "[start]\nsend = go\nsend = faster\nanswer = faster it is\n[stop]\nsend = halt\n"


def start_fails():
    """A command of the start is refused, not taken or not answered: a scanner that took a command gets its stop command, and
    nothing else. The reason is reported."""
    for i, (commands, fault, said, status, word) in enumerate((
            (TWO, "at step start refuse", 0, 74, "refused"), (TWO, "at step start 2 refuse", 2, 74, "refused"),
            (TWO, "at step start 2 timeout", 1, 124, "take a command"), (TWO, "at 1 MB silent", 3, 124, "no answer"),
            (TWO, "at step start 3 unplug", 2, 124, "no answer"),
            (TWO.replace("send = faster\n", ""), "at 1 MB silent", 2, 124, "no answer"),
            (TWO.replace("[stop]\nsend = halt\n", ""), "at 1 MB silent", 2, 124, "no answer"))):
        for kernel in kernels(i):
            with Bus(device(source="pattern 2 MB", kernel=kernel, on_command=True, faults=[fault])) as b:
                r = record(b, commands=commands, patience=2 if status == 124 else bus.PATIENCE)
                m, name = r.model(), "%s %s %r" % (kernel, fault, commands)
                expect(r.report["status"] == status and word in r.err, "%s: %d %s" % (name, r.report["status"], r.err))
                expect(m["commands"] == said, "%s: %d commands" % (name, m["commands"]))
                expect(r.devices[0]["unreaped"] == 0 and not os.path.exists(b.path("out.spool")), "%s: something is left: %s" % (name, r.devices[0]))


def transfers_of_all_sizes():
    for size, transfers in (("512", 1), ("4K", 3), ("16K", 32), ("1M", 2)):
        faults = ["at 300000 short 33", "at 400000 stall", "at 500000 babble 600", "at end stop"]
        with Bus(device(source="pattern 600 KB", faults=faults)) as b:
            r = record(b, size=size, transfers=transfers)
            s, m = whole(b, r)
            expect(r.report["status"] == 0, r.err)


def flood_at_start():
    """A command is not answered while more bytes come than are kept: it fails at its timeout, as if no bytes came."""
    commands = "[start]\nsend = go\nanswer = never\n"
    with Bus(device(source="pattern 40 MB")) as b:
        r = record(b, commands=commands, patience=2)
        expect(r.report["status"] == 124 and "no answer" in r.err, "status %s: %s" % (r.report["status"], r.err))
        expect(r.devices[0]["unreaped"] == 0 and not os.path.exists(b.path("out.spool")), "something is left: %s" % r.devices[0])


def kernels_without():
    """Older kernels lack capabilities that libusb prefers; a plain file behaves otherwise in poll."""
    for off in ("1", "2", "4", "8", "16", "31") if LONG else ("8", "31"):
        with Bus(device(source="pattern 1 MB", caps_off=off, faults=["at 300000 short 33", "at 500000 short 0", "at end stop"])) as b:
            whole(b, record(b))
    with Bus(device(source="pattern 1 MB", poll="file", faults=["at 500000 stall", "at end stop"])) as b:
        whole(b, record(b))


def back_pressure():
    """The program is paused: the device drops what exceeds its buffer, and no more."""
    with Bus(device(source="pattern 3 MB", rate="6 MB", buffer="256 KB", faults=["at 1 MB pause 0.3 s", "at end stop"])) as b:
        r = record(b)
        s, m = whole(b, r)
        expect(m["lost"] > 0, "nothing was lost")


# ---- unplugged ----

STEPS = (["step open", "step claim", "step start"] + ["step submit %d" % n for n in (1, 2, 8, 9, 20)] +
         ["step reap %d" % n for n in (1, 2, 9)] + ["step clear", "step discard 1", "step discard 3", "step release"] + ["0", "1000000", "1 MB", "end"])
COMMAND = "[start]\nsend = go\n[stop]\nsend = halt"


def unplugged_at(kernel, step):
    faults = ["at %s unplug" % step, "at 700 KB stall"] + (["at end stop"] if step != "end" else [])
    if "discard" in step or "release" in step:
        faults.append("at 1200 KB stop")
    with Bus(device(source="pattern 2 MB", kernel=kernel, on_command=True, faults=faults)) as b:
        r = record(b, commands=COMMAND)
        m, d = r.model(), r.devices[0]
        fired = m["faults"][0]["fired"]
        if os.path.exists(b.path("out.spool")):
            s = Spool(b.path("out.spool"))
            expect(s.sha256() == m["sha256"], "%s %s: %d bytes in the spool, %d given; %s; %s" %
                   (kernel, step, len(s.bytes()), m["delivered"], s.events()[-5:], r.err))
            expect(s.end or not fired or not m["delivered"], "%s %s: no END: %s" % (kernel, step, s.events()))
        else:
            expect(m["delivered"] == 0, "%s %s: no spool, and %d bytes given: %s" % (kernel, step, m["delivered"], r.err))
        expect(d["unreaped"] == 0, "%s %s: %d bytes not taken" % (kernel, step, d["unreaped"]))
        if fired and "discard" not in step and "release" not in step:
            expect(r.report["status"] > 0 and r.err.strip(), "%s %s: status %s, said %r" % (kernel, step, r.report["status"], r.err))


def unplugged_at_every_step():
    for i, step in enumerate(STEPS):
        for kernel in kernels(i):
            unplugged_at(kernel, step)


def unplugged_and_back():
    for kernel in ("mock", "real"):
        for delay in ("0.05 s", "0.4 s") if LONG else ("0.1 s",):
            # the second time for longer than anybody who only tries again and again would wait between two tries
            faults = ["at 300000 unplug " + delay, "at 1 MB unplug 1.2 s", "at 1500000 stall", "at end stop"]
            with Bus(device(source="pattern 2 MB", kernel=kernel, faults=faults)) as b:
                r = record(b, "--reconnect")
                expect(r.report["status"] == 0, "status %s: %s" % (r.report["status"], r.err))
                s, m = whole(b, r)
                expect(r.devices[0]["plugs"] == 3, "it came %s times" % r.devices[0]["plugs"])
                expect(s.words().count("left") == 2 and s.words().count("back") == 2, "events %s" % s.events())


def another_comes_back():
    """Another scanner of the same kind at the same port does not continue the capture."""
    faults = ["at 300000 unplug 0.3 s", "at end stop"]
    script = (device(source="pattern 1 MB", port="1-1", serial="1001", faults=faults) +
              device(name="b", source="pattern 1 MB", port="1-2", serial="1002", appear="0.15 s"))
    with Bus(script) as b:
        r = record(b, "--reconnect", "-d", "serial:1001")
        s, m = whole(b, r)
        expect(s.serial == "1001" and r.devices[1]["claims"] == 0 and r.model(1)["delivered"] == 0, "the other one was taken")


def never_back():
    with Bus(device(source="pattern 1 MB", faults=["at 300000 unplug"])) as b:
        p = record(b, "--reconnect", wait=False)
        until(lambda: os.path.exists(b.path("out.spool")) and b"left the device" in open(b.path("out.spool"), "rb").read(), "it has not left")
        os.kill(b.program(p, bus.SCAN), signal.SIGINT)
        r = b.finish(p)
        expect(r.report["status"] == 0, r.err)
        s, m = whole(b, r, ended=True)
        expect("left" in s.words() and "back" not in s.words(), "events %s" % s.events())


# ---- killed ----

def killed():
    for at in ("100000", "1 MB", "step reap 9", "step clear") if LONG else ("1 MB",):
        with Bus(device(source="pattern 2 MB", delivered="delivered", faults=["at %s kill" % at, "at 500000 stall"])) as b:
            r = record(b)
            expect(r.report["signal"] == 9, "it was not killed: %s" % r.report)
            s = Spool(b.path("out.spool"))
            with open(b.path("delivered"), "rb") as f:
                given = f.read()
            expect(not s.end and given.startswith(s.bytes()), "what a kill leaves is no beginning of what came")
            # what was reaped and written before is there: at most what was in flight is missing
            expect(len(given) - len(s.bytes()) <= 9 * 65536, "%d bytes are missing after a kill" % (len(given) - len(s.bytes())))
            # and it can be gone on with
            b.script = device(source="pattern 300 KB", seed=7, faults=["at end stop"])
            r = record(b, "--continue")
            expect(r.report["status"] == 0, "it cannot be gone on with: %s" % r.err)
            after = Spool(b.path("out.spool"))
            expect(after.end and after.bytes().startswith(s.bytes()), "going on changed what was there")
            expect(len(after.bytes()) == len(s.bytes()) + r.model()["delivered"], "going on lost bytes")
            expect("continued" in after.words(), "events %s" % after.events())


# ---- at random ----

VERBS = ["stall", "short", "short 0", "short 33", "babble 700", "error 512", "duplicate 512", "garbage 999", "lose 3000", "delay 0.05 s",
         "unplug 0.05 s", "pause 0.05 s"]


def combination(seed):
    rng = random.Random(seed)
    size = rng.choice((200000, 1000000, 3000000))
    faults = ["at %d %s" % (rng.randrange(size), rng.choice(VERBS)) for _ in range(rng.randrange(1, 9))]
    words = {"source": "pattern %d" % size, "kernel": rng.choice(("mock", "real")), "seed": seed}
    if rng.random() < 0.5:
        words["rate"] = "%d MB" % rng.choice((5, 20, 80))
        if rng.random() < 0.5:
            words["buffer"] = "200 KB"
    if rng.random() < 0.4:
        words["message"] = rng.choice((77, 4096, 5000, 70000))
    if rng.random() < 0.3:
        words["on_command"] = True
    with Bus(device(faults=faults + ["at end stop"], **words)) as b:
        try:
            r = record(b, "--reconnect", size=rng.choice(("4K", "16K", "64K")), transfers=rng.choice((2, 8, 16)),
                       commands=COMMAND if "on_command" in words else "")
            expect(r.report["status"] == 0, "status %s: %s" % (r.report["status"], r.err))
            return whole(b, r, gaps=False)
        except Exception as e:
            raise bus.Fault("seed %d: %s\n%s" % (seed, e, b.script))


def combinations():
    first, n = int(os.environ.get("ACUT_USB_SEED", "1")), int(os.environ.get("ACUT_USB_SEEDS", "60" if LONG else "6"))
    for seed in range(first, first + n):
        combination(seed)


CASES = [each_fault, stopped_in_a_transfer, stopped_at_any_time, transfers_of_all_sizes, start_fails, flood_at_start, kernels_without,
         back_pressure, unplugged_at_every_step, unplugged_and_back, another_comes_back,
         never_back, killed, combinations]

if __name__ == "__main__":
    bus.need()
    sys.exit(bus.run_cases(CASES, sys.argv[1:]))
