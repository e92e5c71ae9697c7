"""The sidecar of an output: it says what the file is, as the file itself and the report do, and appears with it."""
import json
import os
import random

import e2e
from e2e import expect, main


def survey(base):
    rng, path = random.Random(4), os.path.join(base, "a.xyz")
    with open(path, "w") as f:
        f.writelines("%.2f %.2f %.2f\n" % (rng.random() * 400, rng.random() * 300, rng.random() * 20) for _ in range(60000))
    with open(base + "/area.wkt", "w") as f:
        f.write("POLYGON ((0 0, 200 0, 200 300, 0 300))")
    return path


def read(path):
    with open(path) as f:
        return json.load(f)


def comments(path):
    with open(path, "rb") as f:
        head = f.read(16384).split(b"end_header")[0].decode(errors="replace")
    return dict(line.split(" ", 2)[1:] for line in head.splitlines() if line.startswith("comment acut-"))


def says_what_it_is():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "s", survey(base), "--assume-units", "m,m", "--assume-crs", "EPSG:25832").ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        ply, obj, tif = base + "/m.ply", base + "/m.obj", base + "/m.tif"
        got = d.ctl("fetch", job, "-o", ply, "--sidecar", "--canonical", "--z-unit", "ft", "-o", obj, "-o", tif, "--cell", "2m", "--raster", "slope",
                    "--sidecar", "--mask", base + "/area.wkt", "--json").ok().json()
        expect(not os.path.exists(obj + ".json"), "a sidecar that nobody asked for")
        mine, said = read(ply + ".json"), comments(ply)
        expect((mine["file"], mine["format"], mine["bytes"]) == ("m.ply", "ply", os.path.getsize(ply)), str(mine))
        expect((mine["dataset"], mine["generation"], mine["job"]) == ("s", 1, job), str(mine))
        expect(mine["view"] == d.ctl("show", job, "--json").ok().json()["view"], mine["view"])
        expect((mine["crs"], mine["lattice"], mine["trimmed"]) == (said["acut-crs"], said["acut-lattice"], said["acut-trimmed"]), str(mine))
        expect((mine["vertical"], mine["geoid"], mine["wkt"]) == (None, None, None), str(mine))
        expect(" ".join(mine["units"]) == said["acut-units"] and mine["units"] == ["metre", "foot"], str(mine["units"]))
        expect("%s %s" % (mine["digest"], mine["vertex_digest"]) == said["acut-digest"], str(mine))
        expect((mine["mesh_digest"], mine["digest"]) == (got["digest"], got["left_out"]["written_digest"]), str(mine))
        expect((mine["vertices"], mine["triangles"], mine["left_out"]) ==
               (got["vertices"], got["triangles"] - got["left_out"]["triangles"], got["left_out"]["triangles"]), str(mine))
        expect(mine["options"] == {"canonical": True, "polyface": False, "z_unit": "foot", "cell": None, "cell_unit": None, "raster": None,
                                    "interval": None, "interval_unit": None, "base": None, "base_unit": None, "index": None,
                                    "simplify": None, "simplify_unit": None}
               and mine["origin"] is None, str(mine["options"]))
        shown = d.ctl("dataset", "show", "s", "--json").ok().json()
        expect([mine["box"][i] for i in (0, 1, 3, 4)] == [float(v) for v in shown["min"][:2] + shown["max"][:2]], "%s %s" % (mine["box"], shown))
        raster = read(tif + ".json")
        expect((raster["options"]["cell"], raster["options"]["cell_unit"], raster["options"]["raster"]) == (2, "metre", "slope"), str(raster))
        expect(raster["bytes"] == os.path.getsize(tif) and raster["digest"] == mine["digest"], str(raster))
        expect(got["output_bytes"] == sum(os.path.getsize(p) for p in (ply, obj, tif, ply + ".json", tif + ".json")), str(got["output_bytes"]))
        lines = os.path.join(base, "lines.geojson")
        d.ctl("fetch", job, "-o", lines, "--interval", "2m", "--base", "0.5", "--sidecar").ok()
        options = read(lines + ".json")["options"]
        expect([options[n] for n in ("interval", "interval_unit", "base", "base_unit", "index")] == [2, "metre", 0.5, None, 5], str(options))
        expect(mine["simplified"] is None, str(mine["simplified"]))
        # Before any -o it is of all; the origin that was taken off.
        d.ctl("fetch", job, "--sidecar", "-o", ply, "--origin", "1,2,3.5", "-o", obj, "--format", "obj").ok()
        mine = read(ply + ".json")
        expect(mine["origin"] == [1, 2, 3.5] and mine["trimmed"] is None and mine["digest"] == mine["mesh_digest"] == got["digest"], str(mine))
        expect(read(obj + ".json")["format"] == "obj", "the second output")
        # A resumed fetch has one, too; a larger file.
        d.ctl("mesh", base + "/a.xyz", "-o", base + "/one.ply", "--sidecar").ok()
        expect(read(base + "/one.ply.json")["bytes"] == os.path.getsize(base + "/one.ply"), "the size of a larger file")


def by_option():
    """Each triangle counts for the first option that leaves it out, in the report, the sidecar and the index of tiles alike."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "s", survey(base), "--assume-units", "m,m").ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        with open(base + "/hole.wkt", "w") as f:
            f.write("POLYGON ((50 0, 100 0, 100 300, 50 300))")
        names, words, sums = ("trim_hull", "mask", "erase", "max_edge"), [], [(0, 0)]
        for name, value in zip(names, ("4", base + "/area.wkt", base + "/hole.wkt", "3.5")):
            words += ["--" + name.replace("_", "-"), value]
            r = d.ctl("fetch", job, "-o", base + "/m.ply", "--sidecar", *words, "--json").ok()
            left = r.json()["left_out"]
            sums.append((left["triangles"], left["area"]))
        text = d.ctl("fetch", job, "-o", base + "/m.ply", *words).ok().out
        d.ctl("fetch", job, "-o", base + "/tiles", "--tile", "100", *words).ok()
        side, index = read(base + "/m.ply.json"), read(base + "/tiles/index.geojson")["acut"]
        for i, name in enumerate(names):
            got, n, area = left[name], sums[i + 1][0] - sums[i][0], sums[i + 1][1] - sums[i][1]
            expect(n > 0 and got["triangles"] == n and abs(got["area"] - area) < 1e-6 * area, "%s: %s, not %s %s" % (name, got, n, area))
            expect(side["left_out_by"][name]["triangles"] == index["left_out_by"][name]["triangles"] == n, "%s %s" % (side, index))
            expect(abs(side["left_out_by"][name]["area"] - area) < 1e-6 * area, str(side["left_out_by"]))
            expect(": {:,} triangles, an area of {:.6g} square metres\n".format(n, got["area"]) in text, text)
        expect(side["left_out"] == index["left_out"] == sums[-1][0], "%s %s" % (side["left_out"], sums))


def refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "s", survey(base)).ok()
        job = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        with open(base + "/m.ply.json", "w") as f:
            f.write("mine")
        before = sorted(os.listdir(base))
        for words, said in ((["-o", base + "/m.ply", "--no-clobber"], "m.ply.json"), (["-o", "/dev/null", "--format", "ply"], "needs an output that is a file"),
                            (["--format", "null"], "--sidecar has no meaning for null"), (["-o", base + "/t", "--tile", "100"], "index.geojson")):
            r = d.ctl("fetch", job, *words, "--sidecar")
            expect(r.status == 2 and said in r.err, "%s: %d %s" % (words, r.status, r.err))
        d.ctl("push", "s", base + "/a.xyz", "--name", "b").ok()
        other = d.ctl("submit", "s", "--wait", "--json").ok().json()["job"]
        r = d.ctl("fetch", other, "-o", base + "/m.ply", "--sidecar", "--changed-since", "1")
        expect(r.status == 2 and "--sidecar has no meaning for changes" in r.err, r.err)
        expect(sorted(os.listdir(base)) == before, str(os.listdir(base)))
        with open(base + "/m.ply.json") as f:
            expect(f.read() == "mine", "it was replaced")


main(says_what_it_is, by_option, refused)
