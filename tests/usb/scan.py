#!/usr/bin/env python3
"""acut-scan list and probe on a bus: equal devices are told apart, mass storage is left alone, and a device that may not be
opened gives the udev rule that permits it."""
import json
import sys

import bus
from bus import Bus, device, expect
from spool import Spool

TIM = dict(id="19a2:5001", source="cola 100000", rate="200", manufacturer="SICK AG", model="TiM5xx")
STORAGE = dict(id="0781:5567", source="pattern 1 MB", **{"class": "8"}, model="a stick", serial="S1")


def rows(r):
    """--json of list and probe: an object a line."""
    return [json.loads(line) for line in r.out.splitlines()]


def scan(b, *args, **kw):
    profiles = bus.patient_profiles(b.path("profiles"))
    return b.run([bus.SCAN] + list(args) + ["--profiles", kw.pop("profiles", profiles)], **kw)


def untouched(d):
    expect(not d["opens"] and not d["claims"] and not d["detaches"] and not d["submits"], "it was touched: %s" % d)


def lists():
    script = (device("a", port="1-1", serial="18360001", **TIM) + device("b", port="1-2", serial="18360002", **TIM) +
              device("stick", port="1-3", **STORAGE) + device("c", port="1-4", id="1209:0001"))
    with Bus(script) as b:
        r = scan(b, "list", "--json")
        expect(r.status == 0, r.err)
        known = rows(r)
        text = json.dumps(known)
        expect("18360001" in text and "18360002" in text and "1-1" in text and "1-2" in text, text)
        expect("a stick" not in text and "1209" not in text, "strangers are listed: %s" % text)
        r = scan(b, "list", "--all", "--json")
        text = json.dumps(rows(r))
        expect("1-3" in text and "1-4" in text, "--all leaves some out: %s" % text)
        untouched(r.devices[2])
        r = scan(b, "list", "--all")
        expect(r.status == 0 and "18360002" in r.out and "storage" in r.out, r.out)
        untouched(r.devices[2])


def equal_devices():
    stop = ["at 30000 stop"]
    script = device("a", port="1-1", serial="18360001", faults=stop, **TIM) + device("b", port="1-2", serial="18360002", faults=stop, **TIM)
    with Bus(script) as b:
        r = scan(b, "probe")
        expect(r.status == 2 and "18360001" in r.err and "18360002" in r.err and "serial:" in r.err, "it chose one: %s %s" % (r.status, r.err))
        for i, which in ((0, "serial:18360001"), (1, "serial:18360002"), (1, "port:1-2"), (0, "port:1-1")):
            r = scan(b, "record", which, "-o", b.path("s%d" % b.runs), "--no-progress")
            expect(r.status == 0, r.err)
            s = Spool(b.path("s%d" % (b.runs - 1)))
            expect(s.serial == "1836000%d" % (i + 1), "%s took %s" % (which, s.serial))
            expect(s.sha256() == r.model(i)["sha256"] and len(s.bytes()) > 1000, "%s: other bytes" % which)
            expect(r.devices[1 - i]["claims"] == 0, "%s: the other one was claimed" % which)
        r = scan(b, "record", "serial:77", "-o", b.path("none"))
        expect(r.status == 4 and "77" in r.err, "a serial that is not there: %s %s" % (r.status, r.err))


def probes():
    with Bus(device("a", port="1-1", serial="18360001", **TIM)) as b:
        r = scan(b, "probe", "--for", "3")
        expect(r.status == 0, r.err)
        expect("18360001" in r.out, r.out)
        r = scan(b, "probe", "--for", "3", "--json")
        expect(r.status == 0 and rows(r), r.err)
        expect(r.model()["telegrams"] > 10 and r.model()["commands"] == 2, "it did not listen: %s" % r.model())


def mass_storage_alone():
    with Bus(device("stick", port="1-3", **STORAGE)) as b:
        for which in ("serial:S1", "port:1-3", "0781:5567"):
            r = scan(b, "record", which, "--profile", "generic-xyz", "-o", b.path("spool"))
            expect(r.status != 0 and "storage" in r.err, "%s %s" % (r.status, r.err))
            untouched(r.devices[0])


def not_permitted():
    with Bus(device("a", port="1-1", serial="18360001", locked=True, **TIM)) as b:
        r = scan(b, "record", "-o", b.path("spool"))
        expect(r.status == 77, "status %s: %s" % (r.status, r.err))
        for word in ("udev", "19a2", "5001", "/dev/bus/usb/001/"):
            expect(word in r.err, "%s is not in: %s" % (word, r.err))
        r = scan(b, "list")
        expect(r.status == 0 and "18360001" in r.out, "list: %s %s" % (r.out, r.err))


def commands_not_answered():
    for fault, word in (("at step start timeout", "take a command"), ("at step start refuse", "")):
        with Bus(device("a", port="1-1", serial="18360001", faults=[fault], **TIM)) as b:
            r = scan(b, "record", "-o", b.path("spool"), profiles=bus.PROFILES)
            expect(r.status != 0 and r.err.strip() and word in r.err, "%s: %s %s" % (fault, r.status, r.err))
            expect(r.devices[0]["claims"] == r.devices[0]["releases"], "%s: not let go of" % fault)


CASES = [lists, equal_devices, probes, mass_storage_alone, not_permitted, commands_not_answered]

if __name__ == "__main__":
    bus.need()
    sys.exit(bus.run_cases(CASES, sys.argv[1:]))
