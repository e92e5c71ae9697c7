"""Every file of malformed/ through daemon and client: `info` and `mesh` end as tests/input/malformed.tbl says, with an error that
names file, byte, field and reason. The daemon keeps running, and its memory stays bounded."""
import json
import os
import struct
import time

import e2e
from e2e import Fault, expect, main

DATA = e2e.data_dir()
if not DATA:
    e2e.skip("no test data: set ACUT_TEST_DATA")
TABLE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../input/malformed.tbl")
STATUS = {"ok": 0, "bad-input": 1, "truncated": 1, "not-in-this-version": 2}
MEMORY = 64


def rows():
    with open(TABLE) as f:
        for line in f:
            if line.strip() and line[0] != "#":
                name, options, outcome, offset, field, points = line.split()
                yield (name, options, outcome, None if offset == "-" else int(offset),
                       None if field == "-" else field.replace("_", " "), int(points))


def check(run, path, row):
    """Checks the exit status and the form of the message."""
    name, options, outcome, offset, field, points = row
    said = json.loads(run.out)
    expect(run.status == STATUS[outcome], "status %d, %s expected: %s" % (run.status, outcome, run.out))
    if outcome == "ok":
        expect("error" not in said, run.out)
        return said
    e = said["error"]
    expect(list(e) == ["code", "file", "offset", "field", "message", "hint"], "keys %s" % list(e))
    expect(e["code"] == outcome and e["file"] == path and e["offset"] == offset and e["field"] == field and e["message"],
           run.out)
    return None


def every_file():
    known = {}
    for row in rows():
        known.setdefault(row[0], {})[row[1]] = row
    faults = []
    with e2e.Folder() as base, e2e.Daemon(base, memory="%dM" % MEMORY) as d:
        out = os.path.join(base, "out.ply")
        pid = d.process.pid
        for name, of_name in known.items():
            path = os.path.join(DATA, "malformed", name)
            # info takes degrees, and files that end early
            commands = [(["info", "--json", path], of_name.get("t") or of_name.get("p") or of_name["-"])]
            for options, row in of_name.items():
                # what the reader says of degrees is for those who do not project them
                if row[4] != "coordinate system":
                    commands.append((["mesh", "--json", "--planar", "-o", out, path] +
                                     (["--accept-truncated"] if options == "t" else []), row))
            for command, row in commands:
                try:
                    said = check(d.ctl(*command, timeout=e2e.PATIENCE), path, row)
                    # info tells what is there as well as what is claimed
                    expect(not said or command[0] == "info" or said["points"] == row[5], "%s points" % (said or {}).get("points"))
                except (Fault, KeyError, ValueError) as e:
                    faults.append("%s %s: %s" % (command[0], name, e))
                if os.path.exists(out):
                    os.unlink(out)
        expect(not faults, "\n".join(faults))
        d.ctl("ping").ok()
        expect(d.process.poll() is None and d.process.pid == pid, "the daemon is gone")
        expect(d.vmhwm() <= (MEMORY + 32) << 20, "VmHWM %.1f MiB" % (d.vmhwm() / 2**20))
        print("     %d files, VmHWM %.1f MiB" % (len(known), d.vmhwm() / 2**20))


def headers_that_lie():
    """A wrong count in a header gives a warning with both numbers."""
    says = {"int_extremes.las": ("box is wrong", "-21474836.48"), "bbox_inverted.las": ("1000000000 to 0",),
            "trailing_garbage.las": ("64 bytes behind the last point",), "count14_legacy_disagree.las": ("1024", "7")}
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        for name, texts in says.items():
            path = os.path.join(DATA, "malformed/derived", name)
            got = d.ctl("mesh", "--json", "--planar", "-o", os.path.join(base, "o.ply"), path).ok().json()
            for text in texts:
                expect(sum(text in w for w in got["warnings"]) == 1, "%s: %s not once in %s" % (name, text, got["warnings"]))
        # several workers read one file: what they found is put together
        path = os.path.join(DATA, "lidar/las12_pdrf1_ahn3_641k.laz")
        got = d.ctl("mesh", "--json", "-o", os.path.join(base, "o.ply"), path).ok().json()
        expect(not any("header" in w for w in got["warnings"]), "%s" % got["warnings"])
        with open(path, "rb") as f:
            data = bytearray(f.read())
        low = struct.unpack("<d", data[187:195])[0]
        data[179:187] = struct.pack("<d", low + 1)  # points lie beyond the largest x
        data[111] ^= 1            # one point of return 1 more or less
        wrong = os.path.join(base, "wrong.laz")
        with open(wrong, "wb") as f:
            f.write(data)
        got = d.ctl("mesh", "--json", "--scale", "0.001", "-o", os.path.join(base, "o.ply"), wrong)
        expect(got.status in (0, 1), got.out)
        if got.status == 0:
            expect(any("box is wrong" in w and "points of return 1" in w for w in got.json()["warnings"]), got.out)


if __name__ == "__main__":
    main(every_file, headers_that_lie)
