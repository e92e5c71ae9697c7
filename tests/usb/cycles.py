#!/usr/bin/env python3
"""A scanner that is plugged in and pulled out again and again, one that says nothing, and captures begun and ended in a row: descriptors
and memory end where they began, and nothing is done while there is nothing to do."""
import json
import os
import signal
import sys

import bus
from bus import Bus, device, expect, until
from faults import LONG, record, whole
from rest import rests


def plugged_and_unplugged():
    """ACUT_USB_CYCLES times, half of them as mocks and half as real kernels do it; what the program holds is counted each time the device is away."""
    n = int(os.environ.get("ACUT_USB_CYCLES", "50" if LONG else "20"))
    for kernel in ("mock", "real"):
        step = 40000
        faults = ["every %d unplug 0.04 s" % step, "at end stop"]
        with Bus(device(source="pattern %d" % (step * n // 2 + 1000), kernel=kernel, after_close=True, faults=faults)) as b:
            r = record(b, "--reconnect", timeout=max(bus.HANG, n * 2))
            expect(r.report["status"] == 0, r.err)
            s, m = whole(b, r)
            plugs, samples = r.devices[0]["plugs"], r.report["samples"]
            expect(plugs == n // 2 + 1 and len(samples) == n // 2, "%d plugs, %d samples" % (plugs, len(samples)))
            expect(s.words().count("back") == n // 2, "it came back %d times" % s.words().count("back"))
            fds, rss = [x[0] for x in samples], [x[1] for x in samples]
            print("   %s: %d cycles, descriptors %d to %d, memory %d to %d KB" % (kernel, plugs - 1, fds[0], fds[-1], rss[0], rss[-1]))
            # one that is open for a moment is none that is left
            expect(min(fds[-3:]) <= min(fds[:3]), "descriptors: %s" % fds)
            # the first dozen fill libusb's and the allocator's own stores; sanitizers keep freed memory for a while
            if n >= 50 and not bus.sanitizer(bus.SCAN):
                expect(rss[-1] - rss[len(rss) * 4 // 5] <= 128, "memory: %s KB" % rss)


def counted():
    """What is told at the end is of all captures of the process, not of the last one."""
    for kernel in ("mock", "real"):
        faults = ["every 30000 stall", "every 100000 unplug 0.04 s", "at end stop"]
        with Bus(device(source="pattern 450000", kernel=kernel, after_close=True, faults=faults)) as b:
            r = record(b, "--reconnect", "--json")
            expect(r.report["status"] == 0, r.err)
            s, m = whole(b, r)
            end, words = json.loads(r.out.splitlines()[-1]), s.words()
            last = words[len(words) - words[::-1].index("back"):].count("stall")
            expect(end["event"] == "end" and end["unplugged"] == words.count("back") == r.devices[0]["plugs"] - 1 == 4, "%s: %s" % (r.devices[0]["plugs"], end))
            expect(end["stalls"] == words.count("stall") > last > 0, "stalls: %d in the spool, %d in the last capture: %s" % (words.count("stall"), last, end))
            expect(end["bytes"] == m["delivered"], "%d bytes were given: %s" % (m["delivered"], end))


def silent():
    """A scanner that is silent: nothing is done until it speaks."""
    with Bus(device(source="pattern 1 MB", faults=["at 64 KB silent"])) as b:
        p = record(b, wait=False)
        until(lambda: os.path.exists(b.path("out.spool")) and os.path.getsize(b.path("out.spool")) > 64 << 10, "it did not come")
        pid = b.program(p, bus.SCAN)
        woken, cpu, took = rests(pid, 600 if LONG else 60, 0.1, 10.0 if LONG else 1.0)
        print("   silent: %.1f wake-ups a second, %.2f %% of a core" % (woken / took, cpu / took * 100))
        os.kill(pid, signal.SIGINT)
        r = b.finish(p)
        expect(r.report["status"] == 0, r.err)
        whole(b, r)


CASES = [plugged_and_unplugged, counted, silent]

if __name__ == "__main__":
    bus.need()
    sys.exit(bus.run_cases(CASES, sys.argv[1:]))
