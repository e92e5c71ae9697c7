"""Files of a dataset that are pushed again with other options of reading: nothing is skipped silently, and --replace reads them
again."""
import json
import os

import crs
import e2e
import versions
from e2e import expect


def write(path, lines):
    with open(path, "w") as f:
        f.write("".join(line + "\n" for line in lines))
    return path


def grid(form, y=5500000):
    return [form % (500000 + x * 10, y + k * 3, (x * 7 + k) % 5) for x in range(6) for k in range(6)]


def mesh(d, dataset="d"):
    return d.ctl("submit", dataset, "--wait", "--json").ok().json()


def known(d, *args):
    r = d.ctl("push", "d", *args, "--json").ok().json()
    expect(r["state"] == "known", "%s: %s" % (args, r))


def refused(d, *args, says=(), dataset="d"):
    before = d.ctl("dataset", "log", dataset).ok().out
    r = d.ctl("push", dataset, *args)
    expect(r.status == 1, "%s: %d %s" % (args, r.status, r.out + r.err))
    for part in ("has this file already", "--replace", "--add") + tuple(says):
        expect(part in r.err, "%s, for %s: %s" % (part, args, r.err))
    expect(d.ctl("dataset", "log", dataset).ok().out == before, "a refused file made a generation")


def taken(d, *args, dataset="d"):
    r = d.ctl("push", dataset, *args, "--json").ok().json()
    expect(r["state"] == "staged", "%s: %s" % (args, r))


def columns():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = write(base + "/a.txt", grid("%d %d %d"))
        copy = write(base + "/b.txt", grid("%d %d %d"))
        taken(d, path, "--columns", "yxz")
        wrong = mesh(d)
        known(d, path, "--columns", "yxz")
        refused(d, path, says=("--columns yxz", "the columns that it says itself"))
        refused(d, path, "--columns", "xyz", says=("--columns yxz", "--columns xyz"))
        refused(d, path, "--columns", "xyz", "--checksum", says=("as a.txt", "--columns yxz"))
        refused(d, copy, "--checksum", says=("as a.txt", "--columns yxz"))
        refused(d, copy, "--checksum", "--replace", says=("as a.txt", "--columns yxz"))
        refused(d, path, "--columns", "yxz", "--decimal-comma", says=("decimal points", "decimal commas"))
        d.stop()
        d.start()
        refused(d, path, "--columns", "xyz", says=("--columns yxz", "--columns xyz"))

        taken(d, path, "--replace")
        known(d, path)
        known(d, path, "--replace")
        known(d, path, "--input-format", "xyz")
        refused(d, path, "--columns", "yxz")
        right = mesh(d)
        d.ctl("push", "fresh", path).ok()
        expect(right["digest"] == mesh(d, "fresh")["digest"] != wrong["digest"] and right["points"] == 36, "%s %s" % (wrong, right))

        # Both are wanted: each is known then by its own reading.
        taken(d, path, "--columns", "xyz_", "--add")
        expect(mesh(d)["points"] == 72, "beside the first")
        known(d, path)
        known(d, path, "--columns", "xyz_")
        refused(d, path, "--columns", "yxz")
        taken(d, copy, "--replaces", path, "--columns", "yxz")
        expect(mesh(d)["points"] == 36, "in place of both")
        # Said once more, since its answer was lost: as it was said, and otherwise.
        known(d, copy, "--replaces", path, "--columns", "yxz")
        refused(d, copy, "--replaces", path, says=("--columns yxz",))

        las = crs.las(base + "/c.las", x0=500200)
        taken(d, las)
        known(d, las, "--columns", "yxz", "--decimal-comma", "--strict")


def lines_left_out():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        gaps = write(base + "/gaps.csv", ["X,Y,Z"] + grid("%d,%d,%d") + ["500000,5500001,"])
        whole = write(base + "/whole.csv", ["X,Y,Z"] + grid("%d,%d,%d", 5600000))
        taken(d, gaps)
        taken(d, whole)
        refused(d, gaps, "--strict", says=("1 of its lines left out", "--strict"))
        known(d, gaps)
        known(d, whole, "--strict")


def systems():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        utm = crs.las(base + "/utm.las", crs.UTM32)
        none = crs.las(base + "/none.las", x0=500100)
        wrong = crs.las(base + "/wrong.las", crs.DEGREES, x0=500200)
        taken(d, utm)
        taken(d, none, "--assume-crs", "EPSG:25832")
        for path in (utm, none):
            known(d, path)
            known(d, path, "--assume-crs", "EPSG:25832")
            known(d, path, "--override-crs", "EPSG:25832")
            refused(d, path, "--assume-crs", "EPSG:25833", says=("EPSG:25832", "EPSG:25833"))
            refused(d, path, "--override-crs", "EPSG:25833", says=("EPSG:25832", "EPSG:25833", "in place of"))
            refused(d, path, "--override-units", "ft", says=("x and y in metre", "x and y in foot"))
            known(d, path, "--override-units", "m")
        taken(d, wrong, "--override-crs", "EPSG:25832")
        known(d, wrong, "--override-crs", "EPSG:25832")
        refused(d, wrong, says=("EPSG:25832", "what it says itself (EPSG:4326"))


def degrees():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = write(base + "/lonlat.csv", ["lon,lat,h"] + ["9.%03d,50.%03d,%d" % (x, y, x * y % 5) for x in range(6) for y in range(6)])
        taken(d, path, "--assume-crs", "EPSG:4326")
        known(d, path)
        known(d, path, "--assume-crs", "EPSG:4326")
        refused(d, path, "--assume-crs", "EPSG:4258", says=("EPSG:4326", "EPSG:4258"))
        refused(d, path, "--override-crs", "EPSG:32632", says=("EPSG:4326", "EPSG:32632"))
        refused(d, path, "--assume-crs", "EPSG:4326", "--planar", says=("projected", "--planar"))


def ingested():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        os.mkdir(base + "/drop")
        for options, status, where in (((), 0, "done"), (("--columns", "yxz"), 1, "failed"), (("--columns", "xyz", "--replace"), 0, "done")):
            write(base + "/drop/a.txt", grid("%d %d %d"))
            r = d.ctl("ingest", "d", base + "/drop", "--settle", "0", *options)
            expect(r.status == status and "a.txt" in os.listdir(base + "/drop/" + where), "%s: %d %s" % (options, r.status, r.out + r.err))
        with open(base + "/drop/failed/a.txt.error") as f:
            expect("--columns yxz" in json.load(f)["error"]["message"], "the reason beside the file")


def of_an_older_manifest():
    with e2e.Folder() as base:
        expected, d = versions.unpack(6, base)
        with d:
            path = base + "/inputs/a.las"
            r = d.ctl("push", "valley", path, "--checksum", "--strict", "--input-format", "las", "--json").ok().json()
            expect(r["state"] == "known", str(r))
            refused(d, path, "--checksum", "--columns", "yxz", dataset="valley", says=("an older acut", "--columns yxz"))
            before = versions.mesh(d, "valley")
            name = json.loads(d.ctl("dataset", "log", "valley", "--files", "--json").ok().out.splitlines()[0])["files"][0]["path"]
            taken(d, path, "--replaces", name, "--columns", "yxz", dataset="valley")
            versions.same(versions.mesh(d, "valley"), before, "read again")
            r = d.ctl("push", "valley", path, "--columns", "xyz", "--json").ok().json()
            expect(r["state"] == "known", str(r))


if __name__ == "__main__":
    e2e.main(columns, lines_left_out, systems, degrees, ingested, of_an_older_manifest)
