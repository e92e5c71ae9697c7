#!/usr/bin/env python3
"""Many cycles of plugging in and unplugging leak neither descriptors nor memory; the counts at the end include all captures; a silent
scanner costs no processor time."""
import json
import os
import signal
import sys

import bus
from bus import Bus, device, expect, until
from faults import LONG, record, whole
from rest import rests


def plugged_and_unplugged():
    """ACUT_USB_CYCLES cycles, half with umockdev's way to unplug and half with that of real kernels. Descriptors and memory of the
    program are sampled each time the device is away."""
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
            # A descriptor may be open for a moment, so the smallest of three samples counts.
            expect(min(fds[-3:]) <= min(fds[:3]), "descriptors: %s" % fds)
            # The first cycles fill caches of libusb and the allocator. Sanitizers keep freed memory for a while.
            if n >= 50 and not bus.sanitizer(bus.SCAN):
                expect(rss[-1] - rss[len(rss) * 4 // 5] <= 128, "memory: %s KB" % rss)


def counts_of_all_captures():
    """The counts at the end are of all captures of the process, not of the last one."""
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
    """While a scanner is silent, the program rests."""
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


CASES = [plugged_and_unplugged, counts_of_all_captures, silent]

if __name__ == "__main__":
    bus.need()
    sys.exit(bus.run_cases(CASES, sys.argv[1:]))
