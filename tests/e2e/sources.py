"""Files of sources: made when a dataset has many files, kept by pushes, and part of verification, backups, exports and imports. A damaged
one is named, and meshes are made all the same."""
import glob
import json
import os
import random
import shutil
import signal

import e2e
from e2e import Daemon, Folder, expect


def survey(folder, first, n):
    """Makes n small files."""
    os.makedirs(folder, exist_ok=True)
    rng = random.Random(first)
    for i in range(first, first + n):
        with open("%s/tile-%04d.xyz" % (folder, i), "w") as f:
            for _ in range(20):
                f.write("%.2f %.2f %.2f\n" % (rng.uniform(0, 500), rng.uniform(0, 500), rng.uniform(0, 9)))
    return folder


def files(d, dataset=1):
    """The names of files of sources. Others are removed in the background, as old manifests are."""
    def names(begin):
        return sorted(n for n in os.listdir("%s/datasets/%d" % (d.state, dataset)) if n.startswith(begin))

    e2e.until(lambda: len(names("manifest-")) == 1, "one manifest")
    return names("sources-")


def digest(d, *args):
    return d.ctl("submit", *args, "--new", "--wait", "--json").ok().json()["digest"]


def listed(d, name):
    text = d.ctl("dataset", "log", name, "--files", "--json").ok().out
    return sorted(f["name"] for line in text.splitlines() for f in json.loads(line)["files"] or ())


def chains():
    with Folder() as base, Daemon(base) as d:
        d.ctl("push", "d", survey(base + "/a", 0, 100)).ok()
        expect(files(d) == [], "a file of sources for few files: %s" % files(d))
        d.ctl("push", "d", survey(base + "/b", 100, 200)).ok()
        first = files(d)
        expect(len(first) == 1, first)
        size = os.path.getsize(glob.glob(d.state + "/datasets/1/manifest-*")[0])
        expect(size < 2000, "the manifest has %d bytes" % size)
        d.ctl("push", "d", survey(base + "/c", 300, 10)).ok()
        expect(files(d) == first, "a push of few files writes all names")
        want = digest(d, "d")
        d.ctl("push", "d", survey(base + "/d", 310, 130)).ok()
        second = files(d)
        expect(len(second) == 2 and first[0] in second, second)  # 300 are more than twice 140
        d.ctl("dataset", "revert", "d").ok()
        expect(digest(d, "d") == want and files(d) == second, "a revert writes names")
        expect(set(listed(d, "d")) == {"tile-%04d.xyz" % i for i in range(440)}, "other files are listed")
        # The files of the pushes that were reverted are gone for good.
        d.ctl("dataset", "prune", "d", "--keep", "1").ok()
        expect(digest(d, "d") == want, "another mesh")
        shown = d.ctl("dataset", "show", "d", "--json").ok().json()
        expect(shown["files"] == 310, shown)
        d.ctl("push", "d", base + "/a", base + "/b", base + "/c").ok()
        expect(d.ctl("dataset", "show", "d", "--json").ok().json()["generation"] == shown["generation"], "known files were pushed again")
        expect(json.loads(d.ctl("cache", "verify", "--json").ok().out.splitlines()[-1])["damaged"] == 0, "damage")
        d.stop(signal.SIGKILL)
        d.start()
        expect(digest(d, "d") == want, "another mesh")


def damage():
    with Folder() as base, Daemon(base) as d:
        d.ctl("push", "d", survey(base + "/a", 0, 200)).ok()
        want = digest(d, "d")
        path = "%s/datasets/1/%s" % (d.state, files(d)[0])
        whole = open(path, "rb").read()
        survey(base + "/b", 200, 1)
        os.mkdir(base + "/exported")

        def refused(what):
            r = d.ctl("cache", "verify", "--json")
            lines = [json.loads(line) for line in r.out.splitlines()]
            expect(r.status == 1 and lines[-1]["damaged"] == 1 and lines[0]["damaged"] == "sources" and
                   os.path.basename(path) in lines[0]["error"]["file"], "%s: %s" % (what, r.out))
            for command in ("push", "d", base + "/b"), ("dataset", "log", "d", "--files"), ("dataset", "revert", "d"):
                r = d.ctl(*command)
                expect(r.status == 74 and os.path.basename(path) in r.err, "%s, %s: %d %s" % (what, command, r.status, r.err))
            expect(digest(d, "d") == want, "%s: another mesh" % what)

        with open(path, "r+b") as f:
            f.seek(100)
            f.write(b"?")
        refused("changed")
        # What is exported now is refused by who imports it.
        d.ctl("dataset", "export", "d", base + "/out").ok()
        r = d.ctl("dataset", "import", base + "/out", "e")
        expect(r.status != 0 and os.path.basename(path) in r.err, r.err)
        d.stop(signal.SIGKILL)
        d.start()
        refused("after a start")
        os.remove(path)
        refused("gone")
        # Segments are read first: for them the manifest is enough.
        segment = glob.glob(d.state + "/datasets/1/*.seg")[0]
        with open(segment, "r+b") as f:
            f.seek(4500)
            byte = f.read(1)
            f.seek(4500)
            f.write(bytes([byte[0] ^ 1]))
        r = d.ctl("cache", "verify", "--json")
        found = [json.loads(line).get("damaged") for line in r.out.splitlines()]
        expect(r.status == 1 and found == ["segment", "sources", 2], r.out)
        with open(segment, "r+b") as f:
            f.seek(4500)
            f.write(byte)
        with open(path, "wb") as f:
            f.write(whole)
        d.ctl("push", "d", base + "/b").ok()
        expect(json.loads(d.ctl("cache", "verify", "--json").ok().out.splitlines()[-1])["damaged"] == 0, "damage")


def copies():
    with Folder() as base, Daemon(base) as d:
        d.ctl("push", "d", survey(base + "/a", 0, 150)).ok()
        d.ctl("push", "d", survey(base + "/b", 150, 400)).ok()
        want, first = digest(d, "d"), digest(d, "d", "--generation", "1")
        d.ctl("dataset", "export", "d", base + "/out").ok()
        d.ctl("backup", base + "/kept").ok()
        d.ctl("push", "d", survey(base + "/c", 550, 600)).ok()
        d.ctl("dataset", "export", "d", base + "/out").ok()  # into the same folder: what is older goes
        d.ctl("backup", base + "/kept").ok()
        now = digest(d, "d")
        for name in "out", "kept/datasets/1":
            there = sorted(n for n in os.listdir("%s/%s" % (base, name)) if n.startswith("sources-"))
            expect(there == files(d), "%s: %s" % (name, there))
        shutil.copytree(base + "/kept", base + "/state-restored")
        with Daemon(base, name="-restored") as other:
            expect(digest(other, "d") == now and digest(other, "d", "--generation", "2") == want and len(listed(other, "d")) == 1150, "restored")
            # As a task of acut-cluster that was killed leaves it.
            shutil.copy(glob.glob(base + "/out/sources-*")[0], base + "/out/sources-0-0123456789abcdef.new")
            other.ctl("dataset", "import", base + "/out", "e").ok()
            expect(len(files(other, 2)) == 1 and not glob.glob(other.state + "/datasets/2/import-*sources*"), os.listdir(other.state + "/datasets/2"))
            expect(digest(other, "e") == now and digest(other, "e", "--generation", "1") == first and len(listed(other, "e")) == 1150, "imported")
            other.ctl("push", "e", base + "/a", "--checksum").ok()
            expect(other.ctl("dataset", "show", "e", "--json").ok().json()["generation"] == 3, "known files were pushed again")
            expect(json.loads(other.ctl("cache", "verify", "--json").ok().out.splitlines()[-1])["damaged"] == 0, "damage")
        os.remove(glob.glob(base + "/out/sources-*")[0])
        r = d.ctl("dataset", "import", base + "/out", "f")
        expect(r.status != 0 and "sources-" in r.err and "missing" in r.err, r.err)


def without_paths():
    """Another user gets the names of an owner's files, and no path in any file."""
    if os.getuid():
        print("     skipped: needs root")
        return
    from rights import GROUPS, Box
    with Folder() as base, Box(base, args=GROUPS) as box:
        place, secret = base + "/out", survey(base + "/where-anna-keeps-them", 0, 150)
        os.mkdir(place)
        os.chmod(place, 0o777)
        os.chmod(secret, 0o755)
        box.good("anna", "push", "--mode", "664", "d", secret)
        for who, sees in ("anna", True), ("carl", False):
            to = "%s/%s" % (place, who)
            box.good(who, "dataset", "export", "d", to)
            found = [n for n in os.listdir(to) if b"where-anna-keeps-them" in open("%s/%s" % (to, n), "rb").read()]
            expect([n.startswith("sources-") for n in found] == [True] * sees, "%s: %s" % (who, found))
            expect(any(b"tile-0007" in open("%s/%s" % (to, n), "rb").read() for n in os.listdir(to)), "no names")


if __name__ == "__main__":
    e2e.main(chains, damage, copies, without_paths)
