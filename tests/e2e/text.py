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
            (write(base, "list.csv", ["Survey 9", "Pkt;Hochwert;Rechtswert;H\u00f6he;Art"] +
                   ["P%d;%d.5;%d.25;%d;old tree" % (i, p[1], p[0], p[2]) for i, p in enumerate(POINTS)]), ()),
            (write(base, "pnezd.txt", ["%d,%d.5,%d.25,%d,TREE" % (i, p[1], p[0], p[2]) for i, p in enumerate(POINTS)]),
             ("--columns", "_nez_")),
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


def more_digits_than_fit():
    """Numbers as numpy writes them are rounded once: to --scale, to the lattice of the dataset, or to the finest scale that
    fits."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        rows = [(500000 + x * 1.001 / 7, 5400000 + y * 1.3 / 11, x / 13) for x in range(60) for y in range(6)]
        e18 = write(base, "e18.txt", ["%.18e %.18e %.18e" % p for p in rows])
        d8 = write(base, "d8.txt", ["%.8f %.8f %.8f" % (x + 100, y, z) for x, y, z in rows])
        mm = write(base, "mm.txt", ["%.3f %.3f %.3f" % (x + 200, y, z) for x, y, z in rows])
        here = write(base, "here.txt", ["%.3f %.3f %.3f" % tuple(round(v + 1e-9, 3) for v in p) for p in rows])
        rounded = mesh(d, base, e18, "--scale", "0.001")
        expect(rounded["moved"] > 300 and max(rounded["max_shift"][:2]) <= 0.0005 and "0.001" not in str(rounded["warnings"]),
               "%s" % rounded)
        expect(mesh(d, base, here)["digest"] == mesh(d, base, e18, "--scale", "0.001,0.001")["digest"], "not as a text of millimetres")
        alone = mesh(d, base, e18)
        expect(any("rounded to 0.00000001" in w for w in alone["warnings"]) and alone["moved"] > 300, "%s" % alone)
        got = [mesh(d, base, a, b, c) for a, b, c in ((e18, d8, mm), (mm, e18, d8), (d8, mm, e18))]
        expect(len({g["digest"] for g in got}) == 1 and all(g["moved"] == got[0]["moved"] for g in got), "%s" % got)
        expect(all("and 1 more: the coordinates have more digits" in str(g["warnings"]) for g in got), "%s" % got[0]["warnings"])
        wide = write(base, "wide.txt", ["%.18e 0 0" % (x * 1e6 / 7) for x in range(40)])
        error(d.ctl("mesh", "--json", "-o", os.path.join(base, "out.ply"), wide), "bad-input", 1, "does not fit into 32 bits")
        expect(mesh(d, base, wide, "--scale", "0.01")["moved"] > 20, "with a scale it is read")
        # into a lattice that is there: as a file and through a pipe
        for name in ("file", "pipe"):
            d.ctl("push", name, mm).ok()
        d.ctl("push", "file", e18).ok()
        with open(e18, "rb") as f:
            d.ctl("push", "pipe", "-", "--input-format", "xyz", stdin=f).ok()
        digests = [d.ctl("submit", n, "--wait", "--json").ok().json()["digest"] for n in ("file", "pipe")]
        expect(digests[0] == digests[1], "%s" % digests)


def neighbouring_tiles():
    """Numbers with 17 digits, in tiles that are pushed one after the other: the first push leaves room for the others, and
    reports its scale."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        def tile(form, x, y, size):
            rows = [(500000 + (x + i / 7) * size, 5400000 + (y + k / 7) * size, (x * y + i * k) / 13) for i in range(7) for k in range(7)]
            return write(base, "%s-%d-%d.txt" % (form[1:], x, y), [" ".join([form] * 3) % p for p in rows])

        for form, size, scale in (("%.17g", 1000, "0.0001"), ("%.6f", 1000, "0.0001"), ("%.17g", 10000, "0.0005"), ("%.17g", 10, "0.0001")):
            name = "d%s-%d" % (form[2:], size)
            got = d.ctl("push", name, tile(form, 0, 0, size)).ok()
            expect("with room for later pushes: x and y are rounded to %s, z to 0.0001," % scale in got.err, got.err)
            for x, y in ((1, 0), (-1, -1), (40, 40)):
                d.ctl("push", name, tile(form, x, y, size)).ok()
            expect(d.ctl("submit", name, "--wait", "--json").ok().json()["points"] == 4 * 49, name)
        expect("0.000001" in str(mesh(d, base, tile("%.17g", 0, 0, 1000))["warnings"]), "of one step it is the finest")


def many_at_one_position():
    """All commands that wait for a mesh give the warning."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = write(base, "zeros.txt", ["%d %d %d" % p for p in POINTS] + ["0 0 0"] * 100)
        says = "of 136 points (74.2 %) are at one position, 0 0"
        d.ctl("push", "zeros", path).ok()
        job = d.ctl("submit", "zeros", "--wait").ok()
        for r in (d.ctl("mesh", path, "-o", base + "/out.ply").ok(), job, d.ctl("wait", "1").ok()):
            expect(says in r.err, r.out + r.err)
        expect(says not in d.ctl("submit", "zeros", "--wait", "--quiet").ok().err, "quiet")


def far_from_the_rest():
    """A distant point is reported by its long edges, with --ground and without, and by the box of nearly all points."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        rest = ["%d.5 %d.5 %d 2" % (x, y, (7 * x + y) % 9) for x in range(80) for y in range(80)]
        near, far = write(base, "near.txt", rest), write(base, "far.txt", rest + ["90000.5 40.5 3 2"])
        for options in ((), ("--ground",)):
            words = ("-o", base + "/out.ply", "--columns", "xyzc", *options)
            expect("the longest edge is" not in d.ctl("mesh", near, *words).ok().err, "nothing is far")
            r = d.ctl("mesh", far, *words).ok()
            expect("of the mesh's area are triangles with edges above" in r.err and "the longest edge is 89" in r.err, r.err)
        j = d.ctl("info", "--json", "--columns", "xyzc", far).ok().json()
        expect(j["max"][:2] == [90000.5, 79.5] and j["inner_max"][:2] == [79.5, 79.5] and j["inner_min"][:2] == [0.5, 0.5], str(j))
        expect("99.9 %" in d.ctl("info", "--columns", "xyzc", far).ok().out, "the list for people")


def shapes():
    """Decimal commas, UTF-16 and lines without a value, from the option to the JSON."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = os.path.join(base, "out.ply")
        want = mesh(d, base, write(base, "plain.xyz", ["%d.25 %d.5 %d" % p for p in POINTS]))["digest"]
        commas = write(base, "commas.csv", ["! a survey", "X;Y;Z"] + ["%d,25;%d,5;%d" % p for p in POINTS])
        error(d.ctl("mesh", "--json", "-o", out, commas), "bad-input", 1, "--decimal-comma", 3)
        expect(mesh(d, base, commas, "--decimal-comma")["digest"] == want, "decimal commas")
        expect(d.ctl("info", "--json", "--decimal-comma", commas).ok().json()["points"] == 36, "info of decimal commas")
        expect(d.ctl("info", "--json", "--header", "--decimal-comma", commas).ok().json()["points"] == 36, "its header")
        with open(os.path.join(base, "wide.txt"), "wb") as f:
            f.write(open(commas).read().encode("utf-16"))
        expect(mesh(d, base, f.name, "--decimal-comma")["digest"] == want, "UTF-16")
        rows = ["%d.25,%d.5,%d" % p for p in POINTS]
        gaps = write(base, "gaps.csv", ["X,Y,Z"] + rows[:9] + ["1,2,", "1,2,*"] + rows[9:] + ["1,2,nan"])
        got = mesh(d, base, gaps)
        expect(got["digest"] == want and got["lines_left_out"] == 3 and "first is line 11" in str(got["warnings"]), "%s" % got)
        info = d.ctl("info", "--json", gaps).ok().json()
        expect((info["points"], info["lines_left_out"], info["first_left_out"]) == (36, 3, 11), "%s" % info)
        error(d.ctl("mesh", "--json", "--strict", "-o", out, gaps), "bad-input", 1, "--strict", 11)
        got = d.ctl("push", "--json", "s", gaps).ok().json()
        expect(got["lines_left_out"] == 3 and "left out" in got["warning"], "%s" % got)
        with open(write(base, "gaps.xyz", [row for row in open(gaps).read().split()[1:]]), "rb") as f:
            got = d.ctl("push", "--json", "s", "-", "--input-format", "xyz", stdin=f).ok().json()
        expect(got["lines_left_out"] == 3 and got["points"] == 36 and "left out" in got["warning"], "%s" % got)
        expect(not os.path.exists(out), "an output of a refused input")


def what_is_warned_about():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = write(base, "a.csv", ["A survey", "of mine", "E [ft];N [ft];H [m]"] + ["%d;%d;%d" % p for p in POINTS])
        info = d.ctl("info", "--json", path).ok().json()
        expect("2 lines before the points" in info["warning"] and "ft or ftUS" in info["warning"], "%s" % info)
        expect(info["points"] == 36 and info["units"] == {"xy": None, "z": "metre"}, "%s" % info)


def columns_that_are_not_x_y_z():
    """Refused by info, mesh and push alike; with the letters of the hint the file is read."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = os.path.join(base, "out.ply")
        rows = ["%d,%d.25,%d.5,%d" % (i + 1, 5400000 + p[1], 500000 + p[0], p[2]) for i, p in enumerate(POINTS)]
        for name, lines, says, line in (("pnezd.csv", [row + ",GND" for row in rows], "_nez_", 1),
                                        ("xyh.csv", ["Nr,X,Y,H"] + rows, "_nez", 1), ("what.csv", ["", "a,b,c,d"] + rows, "--columns", 2)):
            path = write(base, name, lines)
            for command in (["info"], ["mesh", "-o", out], ["push", "set"]):
                error(d.ctl(command[0], "--json", *command[1:], path), "bad-input", 1, says, line)
            expect(d.ctl("mesh", "--json", "-o", out, "--columns", "_nez_", path).ok().json()["points"] == 36, name)
            os.unlink(out)


def degrees_by_name():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = os.path.join(base, "out.ply")
        path = write(base, "gps.csv", ["latitude,longitude,altitude"] +
                     ["%.5f,%.5f,%d" % (47 + p[1] / 1e4, 9 + p[0] / 1e4, p[2]) for p in POINTS])
        error(d.ctl("mesh", "--json", "-o", out, path), "not-in-this-version", 2, "--assume-crs")
        got = d.ctl("mesh", "--json", "-o", out, "--assume-crs", "EPSG:4326", path).ok().json()
        expect("32632" in json.dumps(got) and got["points"] == 36, "%s" % got)


def without_points():
    """There is no box: its numbers are null in JSON."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        scan = ["0", "0", "0 0 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1"]
        for path in (write(base, "a.xyz", ["# nothing"]), write(base, "a.csv", ["x,y,z"]), write(base, "a.pts", ["0"]),
                     write(base, "a.ptx", scan)):
            for more in ((), ("--header",)):
                text = d.ctl("info", *more, path).ok().out
                expect("inf " not in text and any(line.split() == ["box", "none"] for line in text.splitlines()), text)
                info = d.ctl("info", "--json", *more, path).ok().json()
                expect(info["points"] == 0 and info["min"] == [None] * 3 and info["max"] == [None] * 3, "%s" % info)


if __name__ == "__main__":
    main(same_points_however_written, classes_and_returns, what_is_refused, more_digits_than_fit, neighbouring_tiles, many_at_one_position, far_from_the_rest,
         shapes, what_is_warned_about, columns_that_are_not_x_y_z,
         degrees_by_name, without_points)
