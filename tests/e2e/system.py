"""The whole coordinate system: the WKT that a file carries is kept with its dataset as far as it holds, through everything that
happens to a dataset, and comes with its meshes. A client that does not ask for it gets the head that it always got."""
import json
import os
import select
import shutil
import signal
import struct

import e2e
import geo
from acut_wire import Client, pb
from crs import DEGREES, HEIGHT, UTM32, compound, las, xyz
from e2e import expect
from resume import Half, ask, pending, pends

SPELT = UTM32.replace(",", ", ").replace("ETRS89 / UTM", "ETRS89 / utm")
BOTH = compound(UTM32, HEIGHT)
LONG = UTM32.replace(',AUTHORITY["EPSG","25832"]]', ',EXTENSION["PROJ4","%s"],AUTHORITY["EPSG","25832"]]')


def degrees(path):
    """y from 50.0000000 on, x from 8.0 on, by steps of a tenth."""
    with open(las(path, DEGREES), "rb") as f:
        data = bytearray(f.read())
    at = struct.unpack_from("<I", data, 96)[0]
    for i in range(9):
        struct.pack_into("<ii", data, at + 20 * i, 80 + i % 3, 500 + i // 3)
    struct.pack_into("<2d", data, 131, .1, .1)
    struct.pack_into("<4d", data, 179, 8.2, 8, 50.2, 50)
    with open(path, "wb") as f:
        f.write(data)
    return path


def show(d, name, *args):
    return d.ctl("dataset", "show", name, "--json", *args).ok().json()


def job_of(d, name, *args):
    return d.ctl("submit", name, "--wait", "--json", *args).ok().json()["job"]


def head_of(d, job, system=True):
    c = Client(d.socket)
    try:
        return c.fetch(job, system=system)
    finally:
        c.close()


def is_kept(d, name, wkt, *args):
    """In the answer about the dataset, and in the heads of its meshes, of a selection too, which has a grid of its own."""
    got = show(d, name)
    expect(got["wkt"] == (wkt or None), "%s has %s" % (name, got["wkt"]))
    job = job_of(d, name, *args)
    for one in (job, job_of(d, name, "--every", "1", "--thin", "1", *args)):
        head = head_of(d, one)
        expect(head.wkt == wkt and head.crs == got["crs"], "%s: %s" % (name, head.wkt))
    return job


def through_everything():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        for i in range(3):
            las(base + "/%d.las" % i, [BOTH, BOTH.replace('"both"', '"other"'), BOTH][i], x0=500000 + 100 * i)
        d.ctl("push", "a", base + "/0.las").ok()
        is_kept(d, "a", BOTH)
        got = show(d, "a")
        expect((got["epsg"], got["epsg_z"], got["vertical"], got["geoid"]) == (25832, 7837, "EPSG:7837", None), got)
        d.ctl("push", "a", base + "/1.las").ok()
        d.ctl("push", "a", base + "/2.las").ok()
        is_kept(d, "a", BOTH)
        expect(show(d, "a", "--generation", "1")["wkt"] == BOTH, "in the generation that brought it")
        d.stop(signal.SIGKILL)
        d.start()
        is_kept(d, "a", BOTH)
        d.ctl("dataset", "revert", "a", "1").ok()
        is_kept(d, "a", BOTH)
        d.ctl("dataset", "prune", "a", "--keep", "1").ok()
        is_kept(d, "a", BOTH)
        d.ctl("dataset", "export", "a", base + "/export").ok()
        d.ctl("dataset", "import", base + "/export", "b").ok()
        is_kept(d, "b", BOTH)
        d.ctl("dataset", "rm", "a").ok()
        d.ctl("dataset", "restore", "a").ok()
        is_kept(d, "a", BOTH)
        expect(all(row["wkt"] is None for row in map(json.loads, d.ctl("datasets", "--json").ok().out.splitlines())), "a list")
        # many pushes, until segments are merged
        for i in range(5):
            d.ctl("push", "a", las(base + "/m%d.las" % i, BOTH, x0=510000 + 100 * i)).ok()
        e2e.until(lambda: show(d, "a")["segments"] < 5 and not show(d, "a")["merging"], "no merge")
        is_kept(d, "a", BOTH)


def restored():
    with e2e.Folder() as base:
        with e2e.Daemon(base) as d:
            d.ctl("push", "a", las(base + "/a.las", BOTH)).ok()
            d.ctl("backup", base + "/backup").ok()
        r = e2e.Daemon(base, name="r")
        shutil.copytree(base + "/backup", r.state)
        with r:
            is_kept(r, "a", BOTH)


def interrupted():
    """What an interrupted push knew is known when it is taken up, though its files are not read again."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        paths = [las(base + "/a.las", BOTH), las(base + "/b.las", BOTH.replace('"both"', '"other"'), x0=500100)]
        half = Half(d, "s", paths, 1)
        d.stop(signal.SIGKILL)
        half.vanish()
        d.start()
        expect("1 files" in pending(d, "s"), pending(d, "s"))
        d.ctl("push", "s", *paths).ok()
        is_kept(d, "s", BOTH)


def whose_it_is():
    """Only a source of the dataset gives it its WKT: no file that was probed and then not staged, and no file of an interrupted
    push that is not pushed again."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a = las(base + "/a.las", BOTH)
        b = las(base + "/b.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 25832), (4096, 0, 1, 7837), (4099, 0, 1, 9001)], x0=500100)
        for name, staged, want in (("both", [a, b], BOTH), ("other", [b], ""), ("own", [a], BOTH)):
            half = Half(d, name, [a, b], 0, wait=False)
            for path in staged:
                ask(half.c, "file", path, half.id)
            half.c.ask("push_commit", pb.PushCommit(push=half.id))
            half.vanish()
            is_kept(d, name, want)
        for name, again, want in (("all", [b, a], BOTH), ("one", [b], "")):
            half = Half(d, name, [a, b], 2)
            half.vanish()
            pends(d, name, "2 files")
            d.ctl("push", name, *again).ok()
            is_kept(d, name, want)


# ---- which text holds ----

def what_holds():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("geoid", "add", geo.pgm(base + "/flat.pgm")).ok()
        with open(base + "/given.wkt", "w") as f:
            f.write(UTM32.replace(",", " ,\n "))
        wkt = {"utm": UTM32, "spelt": SPELT, "both": BOTH, "broken": UTM32[:-1],
               "fits": LONG % ("x" * (32700 - len(LONG))), "large": LONG % ("x" * 40000)}
        f = {name: las(base + "/%s.las" % name, text, x0=500000 + 100 * i)
             for i, (name, text) in enumerate(wkt.items())}
        f["keys"] = las(base + "/keys.las", keys=[(1024, 0, 1, 1), (3072, 0, 1, 25832), (4096, 0, 1, 7837), (4099, 0, 1, 9001)])
        f["degrees"] = degrees(base + "/degrees.las")
        f["none"], f["text"] = las(base + "/none.las", x0=501000), xyz(base + "/t.xyz", 501100)
        for i, (names, args, want) in enumerate((
                (["utm"], [], UTM32),
                (["both"], [], BOTH),
                (["utm", "spelt"], [], UTM32),  # spellings do not contradict each other
                (["spelt", "utm"], [], SPELT.replace(", ", ",")),
                (["fits"], [], wkt["fits"]),
                (["large"], [], ""),
                (["broken"], [], None),
                (["keys"], [], ""),
                (["both"], ["--geoid", "flat", "--geoid-way", "ellipsoidal"], UTM32),
                (["both"], ["--override-crs", "EPSG:32632"], ""),
                (["both"], ["--override-units", "ft,ft"], ""),
                (["both"], ["--override-units", ",ft"], UTM32),
                (["both"], ["--override-crs", base + "/given.wkt"], UTM32),
                (["spelt"], ["--override-crs", base + "/given.wkt"], UTM32),
                (["none"], ["--assume-crs", "EPSG:25832"], ""),
                (["none", "text"], ["--assume-crs", base + "/given.wkt"], UTM32),
                (["spelt"], ["--assume-crs", base + "/given.wkt"], SPELT.replace(", ", ",")),
                (["degrees"], [], ""),
                (["degrees"], ["--planar"], DEGREES))):
            r = d.ctl("push", "d%d" % i, *[f[n] for n in names], *args)
            if want is None:
                continue
            r.ok()
            is_kept(d, "d%d" % i, want)
        flat = head_of(d, job_of(d, "d8"))
        expect(flat.geoid.split()[0] == "ellipsoidal" and flat.geoid.split()[2] == "flat", flat.geoid)
        expect(show(d, "d8")["geoid"] == dict(zip(("way", "hash", "name"), flat.geoid.split())), show(d, "d8"))
        expect(show(d, "d8")["vertical"] == "ellipsoidal height (flat)" and show(d, "d8")["epsg_z"] is None, show(d, "d8"))
        with open(f["both"], "rb") as pipe:
            d.ctl("push", "pipe", "-", stdin=pipe).ok()
        is_kept(d, "pipe", BOTH)


def of_a_file():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        for path, wkt in ((las(base + "/a.las", BOTH.replace(",", ", ")), BOTH), (las(base + "/b.las"), None), (xyz(base + "/c.xyz"), None)):
            for how in ([], ["--header"]):
                got = d.ctl("info", path, "--json", *how).ok().json()
                expect(got["wkt"] == wkt, "%s: %s" % (path, got["wkt"]))
        expect(BOTH in d.ctl("info", base + "/a.las").ok().out and "wkt" not in d.ctl("info", base + "/b.las").ok().out, "as a text")


def known_since():
    """A dataset without one learns it from a later push; what was before stays as it was."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        keys = [(1024, 0, 1, 1), (3072, 0, 1, 25832)]
        d.ctl("push", "a", las(base + "/k.las", keys=keys)).ok()
        first = is_kept(d, "a", "")
        d.ctl("push", "a", las(base + "/u.las", UTM32, x0=500100)).ok()
        is_kept(d, "a", UTM32)
        expect(show(d, "a", "--generation", "1")["wkt"] is None and show(d, "a", "--generation", "2")["wkt"] == UTM32, "by generation")
        expect(head_of(d, first).wkt == "", "a mesh of the generation before")
        d.ctl("dataset", "revert", "a").ok()
        is_kept(d, "a", UTM32)


def stream_of(d, job, **more):
    c = Client(d.socket)
    _, fd = c.ask("fetch", pb.Fetch(job=job, **more))
    data = b""
    while True:
        part = os.read(fd, 1 << 20) if select.select([fd], [], [], e2e.PATIENCE)[0] else b""
        if not part:
            break
        data += part
    os.close(fd)
    c.close()
    return data


def who_does_not_ask():
    """An older client: its head ends behind the view. One that asks differs in the head alone."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", las(base + "/a.las", BOTH)).ok()
        job = job_of(d, "a")
        old, new = stream_of(d, job), stream_of(d, job, system=True)
        length = [struct.unpack_from("<Q", s, 8)[0] for s in (old, new)]
        expect(old[32 + length[0]:] == new[32 + length[1]:], "blocks differ")
        head = head_of(d, job, system=False)
        expect((head.wkt, head.geoid) == ("", ""), "what nobody asked for")
        texts = [head.lattice, head.crs, head.unit_xy, head.unit_z, head.view]
        expect(length[0] == (48 + sum(2 + len(t) for t in texts) + 7) // 8 * 8, "the old head has %d bytes" % length[0])
        expect(new[32:32 + length[1]].rstrip(b"\0").endswith(BOTH.encode()), "the WKT is last")
        # and the answer about a dataset
        c = Client(d.socket)
        one = lambda **more: c.ask("datasets_request", pb.DatasetsRequest(name="a", **more)).datasets[0]
        expect(one().wkt == "" and one(system=True).wkt == BOTH and one(generation=1).wkt == BOTH, "a dataset")
        c.close()


if __name__ == "__main__":
    e2e.main(through_everything, restored, interrupted, whose_it_is, what_holds, of_a_file, known_since, who_does_not_ask)
