"""Files with a part of a mesh (--max-edge, --tile, --bbox, --changed-since) say so, their digest is that of their triangles, and
acut-verify accepts them as such."""
import glob
import os
import random

import e2e
from e2e import expect, main, run


def comments(path):
    with open(path, "rb") as f:
        head = f.read(16384).split(b"end_header")[0].decode(errors="replace")
    return dict(line.split(" ", 2)[1:] for line in head.splitlines() if line.startswith("comment acut-"))


def verified(path, *points):
    got = run([e2e.VERIFY, "--json", path, *points]).ok().json()
    digest = comments(path)["acut-digest"].split()
    expect(got["good"] and got["digest_in_file"] and got["digest"] == digest[0] and got["vertex_digest"] == digest[1], str(got))
    return got


def survey(base, seed, name):
    """Clusters far from each other, so that some edges are long."""
    rng, path = random.Random(seed), os.path.join(base, name)
    with open(path, "w") as f:
        for _ in range(60):
            x, y = rng.randrange(100000), rng.randrange(100000)
            f.writelines("%d.%d %d.%d %d.5\n" % (x + rng.randrange(300), rng.randrange(10), y + rng.randrange(300), rng.randrange(10), i)
                         for i in range(40))
    return path


def says_what_it_is():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path = survey(base, 1, "a.xyz")
        whole, part, obj = base + "/whole.ply", base + "/part.ply", base + "/part.obj"
        d.ctl("mesh", path, "-o", whole).ok()
        expect("acut-trimmed" not in comments(whole) and not verified(whole, path)["trimmed"], "the whole mesh")
        for limit, words in (("900.5", "max-edge=900.5"), ("1e9", "max-edge=1e9"), ("0.001", "max-edge=0.001")):
            got = d.ctl("mesh", path, "--max-edge", limit, "-o", part, "-o", obj, "--json").ok().json()
            expect(comments(part)["acut-trimmed"].replace("1000000000", "1e9") == words, comments(part)["acut-trimmed"])
            v = verified(part, path)
            expect(v["trimmed"] and v["digest"] == got["left_out"]["written_digest"], "%s %s" % (v, got["left_out"]))
            expect(v["triangles"] == got["triangles"] - got["left_out"]["triangles"] and v["vertices"] == got["vertices"], str(v))
            with open(obj) as f:
                lines = [l for l in f if l.startswith("#")]
            expect(any("acut-trimmed " + comments(part)["acut-trimmed"] in l for l in lines)
                   and any("acut-digest " + comments(part)["acut-digest"] in l for l in lines), str(lines))
        expect(v["triangles"] == 0, "all edges are longer")
        # Without the comment it would be called wrong, and with the digest of the whole mesh, too.
        d.ctl("mesh", path, "--max-edge", "900.5", "-o", part).ok()
        with open(part, "rb") as f:
            data = f.read()
        for old, new in ((b"acut-trimmed", b"acut-tr-mmed"), (comments(part)["acut-digest"].encode(), comments(whole)["acut-digest"].encode())):
            with open(base + "/bad.ply", "wb") as f:
                f.write(data.replace(old, new))
            expect(run([e2e.VERIFY, base + "/bad.ply"]).status == 1, "%s is not missed" % old)


def windows_tiles_changes():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        path, more = survey(base, 2, "a.xyz"), survey(base, 3, "b.xyz")
        out = base + "/out.ply"
        d.ctl("push", "d", path).ok()
        first = d.ctl("submit", "d", "--wait", "--json").ok().json()
        d.ctl("fetch", first["job"], "-o", out, "--bbox", "20000,20000,60000,60000").ok()
        expect(comments(out)["acut-trimmed"] == "window" and verified(out, path)["trimmed"], "a window")
        d.ctl("fetch", first["job"], "-o", out, "--bbox", "20000,20000,60000,60000", "--max-edge", "5000").ok()
        expect(comments(out)["acut-trimmed"] == "max-edge=5000 window" and verified(out, path), str(comments(out)))
        d.ctl("fetch", first["job"], "-o", base + "/tiles", "--tile", "25000", "--max-edge", "9000").ok()
        tiles = glob.glob(base + "/tiles/*.ply")
        expect(len(tiles) > 4 and all(comments(t)["acut-trimmed"] == "max-edge=9000 tile=25000" and verified(t, path) for t in tiles),
               str(tiles))
        d.ctl("push", "d", more).ok()
        second = d.ctl("submit", "d", "--wait", "--json").ok().json()
        d.ctl("fetch", second["job"], "-o", out, "--changed-since", first["generation"]).ok()
        expect(comments(out)["acut-trimmed"] == "changes" and verified(out, path, more), "changes")


main(says_what_it_is, windows_tiles_changes)
