#!/usr/bin/env python3
"""The pretended scanner itself, with a minimal capture program: its report is right, whatever the faults."""
import sys

import bus
from bus import Bus, device, expect, sha256


def capture(b, *more, **kw):
    r = b.run([bus.PLAIN, "19a2:5001", b.path("out")] + list(more), **kw)
    m = r.model()
    expect(r.report["status"] == 0, "status %s: %s" % (r.report["status"], r.err))
    expect(sha256(b.path("out")) == m["sha256"], "what came is not what the model says that it gave: %s" % m)
    expect(r.devices[0]["unreaped"] == 0, "transfers were not taken")
    return r, m


def explains(source, got, rows, over=0):
    """The rows turn the source into what was delivered."""
    at = 0
    want = bytearray()
    for row in rows:
        want += source[at:row["source"]]
        at = row["source"] + row["lost"]
        expect(len(want) == row["delivered"], "row %s is not at its place (%d)" % (row, len(want)))
        want += got[len(want):len(want) + row["added"]]
    want += source[at:]
    expect(bytes(want) == got, "the rows do not explain what was delivered")


FAULTS = ["at 3 MB stall", "at 1 MB short 100", "at 1 MB short 0", "at 2 MB garbage 1000", "at 2000000 duplicate", "at 2500000 delay 0.1 s",
          "at 3500000 lose 1000", "at 3600000 babble 700", "at 3700000 error 512", "every 900 KB stall", "at end stop"]


def each_fault():
    for kernel in ("mock", "real"):
        for poll in ("fifo", "file"):
            s = device(id="19a2:5001", source="pattern 4 MB", kernel=kernel, poll=poll, faults=FAULTS)
            with Bus(s) as b:
                r, m = capture(b)
                expect(all(f["fired"] for f in m["faults"]), "not all faults happened: %s" % m["faults"])
                with open(b.path("out"), "rb") as f:
                    explains(bus.source_bytes(s, b.path("source")), f.read(), m["rows"])


def rate_and_memory():
    with Bus(device(id="19a2:5001", source="pattern 2 MB", rate="4 MB", buffer="128 KB", faults=["at 1 MB pause 0.3 s", "at end stop"])) as b:
        r, m = capture(b)
        expect(m["lost"] > 0 and m["delivered"] + m["lost"] == 2 << 20, "nothing was lost over a pause: %s" % m)


def unplugged():
    for kernel in ("mock", "real"):
        for at in ("at 1 MB", "at step claim", "at step submit 5", "at step reap 3"):
            with Bus(device(id="19a2:5001", source="pattern 4 MB", kernel=kernel, rate="40 MB", faults=[at + " unplug"])) as b:
                r = b.run([bus.PLAIN, "19a2:5001", b.path("out")])
                expect(sha256(b.path("out")) == r.model()["sha256"], "%s %s: %s" % (kernel, at, r.err))


def capabilities():
    for off in (1, 2, 4, 8, 16, 31):
        faults = ["at 1 MB stall", "at 1500000 short 100", "at end stop"]
        with Bus(device(id="19a2:5001", source="pattern 2 MB", caps_off=str(off), faults=faults)) as b:
            capture(b)


def telegrams():
    s = device(id="19a2:5001", serial="14020042", source="cola 50", faults=["at end stop"])
    with Bus(s) as b:
        r, m = capture(b, "0", "\2sEN LMDscandata 1\3")
        with open(b.path("out"), "rb") as f:
            got = f.read()
        expect(got.startswith(b"\2sEA LMDscandata 1\3\2sSN LMDscandata "), "it answered %r" % got[:40])
        expect(got.count(b"\2") == got.count(b"\3") == 51 and m["telegrams"] == 50, "not 50 telegrams")


if __name__ == "__main__":
    bus.need()
    sys.exit(bus.run_cases([each_fault, rate_and_memory, unplugged, capabilities, telegrams], sys.argv[1:]))
