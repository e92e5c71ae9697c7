#!/usr/bin/env python3
"""From the bus to the mesh, through acutd: what a scanner sends over a faulty bus gives the same telegrams, points and mesh as the same
bytes from a file."""
import json
import os
import random
import struct
import sys

import bus
from bus import SCAN, Bus, Fault, device, expect
from e2e import ACUTD, Daemon, run
from faults import kernels
from spool import Spool, cut_again

CRS = "EPSG:25832"
NOTHING_LOST = ["at 30000 stall", "at 70000 short 11", "at 90000 short 0", "at 110000 delay 0.05 s", "at 150001 stall"]


def scan(*args, status=0):
    r = run([SCAN] + list(args), timeout=bus.HANG, env=bus.sanitized_env(SCAN))
    expect(r.status == status, "%s: %s %s" % (args, r.status, r.err))
    return r


def digest(d, name):
    job = d.ctl("submit", name, "--new", "--wait", "--json").ok().json()
    return job["digest"], job["vertex_digest"], job["points"]


def record(b, *args):
    r = b.run([SCAN, "record", "--no-progress", "--profiles", b.path("profiles"), "-o", b.path("usb.spool")] + list(args))
    expect(r.report["status"] == 0, r.err)
    s = Spool(b.path("usb.spool"))
    expect(s.sha256() == r.model()["sha256"], "other bytes")
    return r, s


def profile(b, name, text):
    os.makedirs(b.path("profiles"), exist_ok=True)
    with open(b.path("profiles/%s.conf" % name), "w") as f:
        f.write(text)


def shipped(name):
    with open(os.path.join(bus.PROFILES, name + ".conf")) as f:
        return bus.patient(f.read())


def texts(path):
    return [json.loads(line).get("text", "no text") for line in scan("replay", path, "--to", "telegrams").out.splitlines()]


def lines():
    """A scanner that sends lines of text: pushed from the bus, from a file and as text, the mesh is the same."""
    rng = random.Random(5)
    text = "".join("%.2f %.2f %.2f\n" % (500000 + x, 5400000 + y, 300 + 0.1 * x + rng.random())
                   for x, y in ((rng.random() * 200, rng.random() * 200) for _ in range(8000))).encode()
    for i, kernel in enumerate(kernels(1)):
        faults = NOTHING_LOST + ["at end stop"]
        with Bus(device(source="file source", kernel=kernel, faults=faults)) as b, Daemon(b.path("")) as d:
            with open(b.path("source"), "wb") as f:
                f.write(text)
            profile(b, "lines", shipped("generic-xyz") + "[match]\nvendor = 0x1209\nproduct = 1\n")
            r, s = record(b)
            expect(s.bytes() == text and s.words().count("stall") == 2, "other bytes")
            scan("record", "--from", b.path("source"), "--profiles", b.path("profiles"), "--profile", "lines", "-o", b.path("file.spool"), "-q")
            for name in ("usb", "file"):
                got = json.loads(scan("push", b.path(name + ".spool"), "--into", name, "--crs", CRS, "--socket", d.socket, "--json").out)
                expect(got["points"] == 8000, "%s: %s" % (name, got))
            with open(b.path("plain.xyz"), "wb") as f:
                f.write(text)
            d.ctl("push", "plain", "--assume-crs", CRS, b.path("plain.xyz")).ok()
            got = [digest(d, name) for name in ("usb", "file", "plain")]
            expect(got[0] == got[1] == got[2], "meshes differ: %s" % got)


def torn_lines():
    """Unplugs and losses within lines: every line that comes out was sent so."""
    text = "".join("%d.25 %d.5 %d.75\n" % (500000 + i, 5400000 + (i * 7) % 1000, 100 + i % 50) for i in range(6000)).encode()
    faults = ["at 50003 unplug 0.05 s", "at 80017 babble 333", "at 110005 error 100", "at 140001 unplug 0.05 s", "at end stop"]
    with Bus(device(source="file source", faults=faults)) as b:
        with open(b.path("source"), "wb") as f:
            f.write(text)
        profile(b, "lines", shipped("generic-xyz").replace("starts-torn = no", "starts-torn = yes") + "[match]\nvendor = 0x1209\nproduct = 1\n")
        record(b, "--reconnect")
        got = texts(b.path("usb.spool"))
        sent = set(text.decode().split("\n"))
        wrong = [line for line in got if line not in sent]
        expect(not wrong and 5900 < len(got) < 6000, "%d lines, never sent: %s" % (len(got), wrong[:5]))


def telegrams(b, faults, n=300):
    profile(b, "tim", shipped("sick-tim").replace("mount-pitch = 0", "mount-pitch = -90").replace("range-max = 25", "range-max = 60"))
    b.script = device(id="19a2:5001", serial="18360001", source="cola %d" % n, rate="200", delivered="given", faults=faults + ["at end stop"])
    return record(b)


def poses(b, s):
    """The scanner moves eastwards, one metre in each sweep, ten metres above the ground."""
    start = s.utc_ns * 1e-9 - 20
    with open(b.path("poses.csv"), "w") as f:
        f.write("time,easting,northing,height,roll,pitch,heading\n")
        for i in range(1200):
            f.write("%.6f,%.3f,%.3f,%.3f,0,0,90\n" % (start + i / 20, 500000 + i * 10, 5400000 + (i % 7) * 0.01, 100))


def heights(path):
    with open(path, "rb") as f:
        head = f.read(235)
    return struct.unpack_from("<dd", head, 211)[::-1], struct.unpack_from("<Q", head + bytes(20), 227)


def sweeps():
    """A TiM with poses: the telegrams are those of the same bytes in a file, the points are on the ground, and the mesh does not
    depend on how the bus cut the bytes."""
    with Bus() as b, Daemon(b.path("")) as d:
        r, s = telegrams(b, NOTHING_LOST)
        m = r.model()
        expect(m["telegrams"] == 300 and m["commands"] == 2, "the scanner was not told: %s" % m)
        scan("record", "--from", b.path("given"), "--profiles", b.path("profiles"), "--profile", "tim", "-o", b.path("file.spool"), "-q")
        one = texts(b.path("usb.spool"))
        expect(one == texts(b.path("file.spool")), "other telegrams")
        expect(sum(t.startswith("sSN LMDscandata") for t in one) == 300, "%d telegrams" % len(one))
        poses(b, s)
        cut_again(s, b.path("cut.spool"), 5)
        for name in ("usb", "cut"):
            out = scan("push", b.path(name + ".spool"), "--pose", b.path("poses.csv"), "--crs", CRS, "--into", name, "--socket", d.socket, "--json").out
            got = json.loads(out)
            expect(got["points"] == 300 * 145, "%s: %s" % (name, out))
        expect(digest(d, "usb") == digest(d, "cut"), "the mesh depends on how the bus cut the bytes")
        scan("push", b.path("usb.spool"), "--pose", b.path("poses.csv"), "--crs", CRS, "-o", b.path("out.las"))
        (low, high), _ = heights(b.path("out.las"))
        expect(88.5 < low < high < 91.5, "the ground is between %s and %s" % (low, high))


def bad_telegrams():
    """Garbage, duplicates and losses cost the telegrams that they hit, and no others."""
    with Bus() as b:
        r, s = telegrams(b, ["at 100000 garbage 700", "at 200000 babble 64", "at 300000 lose 3000", "at 360000 duplicate 512"])
        sent = {t.rstrip(b"\x03").decode() for t in bus.source_bytes(b.script, b.path("clean")).split(b"\x02") if t}
        came = texts(b.path("usb.spool"))
        right = [t for t in came if t in sent]
        expect(len(sent) == 300 and 290 <= len(set(right)) < 300, "%d telegrams of 300 are there" % len(set(right)))
        counts = json.loads(scan("replay", b.path("usb.spool"), "--json").out)
        told = counts["bad_telegrams"] + counts["undecoded"] if "undecoded" in counts else counts["bad_telegrams"]
        expect(told > 0, "nothing is said of bad ones: %s" % counts)


CASES = [lines, torn_lines, sweeps, bad_telegrams]

if __name__ == "__main__":
    bus.need()
    if not os.path.exists(ACUTD):
        raise Fault("no acutd")
    sys.exit(bus.run_cases(CASES, sys.argv[1:]))
