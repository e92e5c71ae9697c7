"""Text inputs through daemon and client: columns by letters and by a line of names, .pts, and what is refused."""
import json
import os

import e2e
from e2e import expect, main

POINTS = [(x, y, (x * 7 + y * 3) % 5) for x in range(6) for y in range(6)]


def write(base, name, lines, end="\n"):
    path = os.path.join(base, name)
    with open(path, "w", newline="") as f:
        f.write("".join(line + end for line in lines))
    return path


def mesh(d, base, path, *more):
    out = os.path.join(base, "out.ply")
    r = d.ctl("mesh", "--json", "--no-clobber", "-o", out, path, *more).ok().json()
    os.unlink(out)
    return r


def error(run, code, status, says, line=None):
    e = json.loads(run.out)["error"]
    expect(run.status == status and e["code"] == code, "%d %s" % (run.status, run.out))
    expect(says in e["message"] + (e["hint"] or "") and e["message"] and (line is None or e["offset"] == line), run.out)


def same_points_however_written():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        texts = [
            (write(base, "plain.xyz", ["%d.25 %d.5 %d" % p for p in POINTS]), ()),
            (write(base, "crlf.csv", ["X,Y,Z"] + ["%d.25,%d.5,%d" % p for p in POINTS], "\r\n"), ()),
            (write(base, "names.csv", ["id;z;y;x"] + ["%d;%d;%d.5;%d.25" % (i, p[2], p[1], p[0])
                                                     for i, p in enumerate(POINTS)]), ()),
            (write(base, "letters.txt", ["a %d.5 %d.25 b %d" % (p[1], p[0], p[2]) for p in POINTS]),
             ("--columns", "_yx_z")),
            (write(base, "scan.pts", ["%d" % len(POINTS)] + ["%d.25 %d.5 %d -120 1 2 3" % p for p in POINTS]), ()),
        ]
        digests = set(mesh(d, base, path, *more)["digest"] for path, more in texts)
        expect(len(digests) == 1, "digests %s" % digests)


def classes_and_returns():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        lines = ["%d %d %d %d 1 %d" % (p + (2 if p[0] < 3 else 7, 1 + (p[1] > 2))) for p in POINTS]
        path = write(base, "a.xyz", lines)
        expect(mesh(d, base, path)["used"] == 36, "columns beyond the third are not looked at")
        got = mesh(d, base, path, "--columns", "xyzcrn")
        expect(got["used"] == 18 and got["removed"]["noise"] == 18, "%s" % got)
        got = mesh(d, base, path, "--columns", "xyzcrn", "--returns", "last", "--keep-noise")
        expect(got["used"] == 18, "%s" % got)
        info = d.ctl("info", "--json", "--columns", "xyzcrn", path).ok().json()
        expect("xyzcrn" in info["variant"], "%s" % info)


def what_is_refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = os.path.join(base, "out.ply")
        commas = write(base, "commas.xyz", ["1 2 3", "123,45 67,8 9,1"])
        for command in (["info", "--json", commas], ["mesh", "--json", "-o", out, commas]):
            error(d.ctl(*command), "bad-input", 1, "decimal comma", 2)
        plain = write(base, "plain.xyz", ["1 2 3", "4 5 6"])
        for letters in ("xy", "xyzz", "xyzq", "xyzr"):
            for command in (["info", "--json", plain], ["mesh", "--json", "-o", out, plain]):
                error(d.ctl(*command, "--columns", letters), "usage", 2, letters)
        error(d.ctl("mesh", "--json", "-o", out, "--columns", "xyzc", plain), "bad-input", 1, "fewer than 4 columns", 1)
        short = write(base, "short.pts", ["3", "1 2 3", "4 5 6"])
        error(d.ctl("mesh", "--json", "-o", out, short), "truncated", 1, "missing", 1)
        expect(not os.path.exists(out), "an output of a refused input")
        got = d.ctl("mesh", "--json", "--accept-truncated", "-o", out, short).ok().json()
        expect(got["points"] == 2, "%s" % got)


def what_is_warned_about():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = write(base, "a.csv", ["E;N;H"] + ["%d;%d;%d" % p for p in POINTS])
        info = d.ctl("info", "--json", path).ok().json()
        expect("does not say for sure" in info["warning"] and info["points"] == 36, "%s" % info)


if __name__ == "__main__":
    main(same_points_however_written, classes_and_returns, what_is_refused, what_is_warned_about)
