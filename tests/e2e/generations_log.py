"""Reports about generations: the log, hashes of content, classes of points."""
import os
import random
import shutil
import subprocess

import e2e
from e2e import expect
from generations import cloud, log
from survey import says, show
import xxhash  # after generations.py, which skips if it is not there


def classes_of_the_generation():
    """The report counts classes of the generation that was meshed, not of replaced files."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, rng = os.path.join(base, "a.xyz"), random.Random(3)

        def write(classes):
            with open(a, "w") as f:
                for i in range(300):
                    f.write("%d.25 %d.5 %d %d\n" % (rng.randrange(9999), rng.randrange(9999), i, classes[i % len(classes)]))

        def notes(*at):
            job = d.ctl("submit", "s", "--wait", *at).ok().out.split()[0]
            return " ".join(d.ctl("show", job, "--json").ok().json()["notes"])

        write((2, 5, 5))
        d.ctl("push", "s", a, "--columns", "xyzc").ok()
        expect("100 of the ground" in notes() and "200 others" in notes(), notes())
        write((2,))
        d.ctl("push", "s", a, "--columns", "xyzc", "--replace").ok()
        expect("others" not in notes(), notes())
        expect("200 others" in notes("--at", "1"), notes("--at", "1"))
        # Of a segment of which some files do not count any more: as many as there are without them, whatever these had.
        b, c = os.path.join(base, "b.xyz"), os.path.join(base, "c.xyz")
        with open(b, "w") as f:
            f.writelines("%d.75 %d.5 %d 2\n" % (rng.randrange(9999), rng.randrange(9999), i) for i in range(40))
        write((2, 5, 5))
        os.rename(a, c)
        d.ctl("push", "t", c, b, "--columns", "xyzc").ok()
        job = lambda: " ".join(d.ctl("show", d.ctl("submit", "t", "--wait").ok().out.split()[0], "--json").ok().json()["notes"])
        expect("140 of the ground" in job() and "200 others" in job(), job())
        os.truncate(b, 0)
        d.ctl("push", "t", b, "--columns", "xyzc", "--replace").ok()
        expect("at least 100 of the ground" in job() and "at least 160 others" in job(), job())
        # More are gone than are left of either kind: the records say what they are.
        def put(name, classes, n):
            path = os.path.join(base, name)
            with open(path, "w") as f:
                f.writelines("%d.25 %d.5 %d %d\n" % (rng.randrange(9999), rng.randrange(9999), i, classes[i % len(classes)]) for i in range(n))
            return path

        kept, gone = put("kept.xyz", (2, 5, 5), 300), put("gone.xyz", (2,), 900)
        d.ctl("push", "u", kept, gone, "--columns", "xyzc").ok()
        put("gone.xyz", (7,), 3)
        d.ctl("push", "u", gone, "--columns", "xyzc", "--replace").ok()
        of = lambda name, *words: " ".join(d.ctl("show", d.ctl("submit", name, "--wait", *words).ok().out.split()[0], "--json").ok().json()["notes"])
        expect("100 of the ground" in of("u") and "200 others" in of("u") and "at least" not in of("u"), of("u"))
        # The same with more records than are looked at.
        kept, gone = put("many.xyz", (2, 5, 5), 300000), put("gone.xyz", (2,), 900000)
        d.ctl("push", "w", kept, gone, "--columns", "xyzc").ok()
        put("gone.xyz", (7,), 3)
        d.ctl("push", "w", gone, "--columns", "xyzc", "--replace").ok()
        expect("at least" in of("w") and "others" in of("w"), of("w"))
        # The ground is gone: none of what is left is, and what is said of --ground knows it.
        kept, gone = put("kept.xyz", (5,), 300), put("gone.xyz", (2,), 900)
        d.ctl("push", "v", kept, gone, "--columns", "xyzc").ok()
        put("gone.xyz", (5,), 3)
        d.ctl("push", "v", gone, "--columns", "xyzc", "--replace").ok()
        expect("of the ground" not in of("v"), of("v"))
        r = d.ctl("submit", "v", "--wait", "--ground", "--crop", "0,0,5000,5000")
        expect(r.status == 1 and "no ground points" in r.err and "classify it" in r.err, r.err)
        # If it is not certain, there is no message.
        os.truncate(c, 0)
        with open(b, "w") as f:
            f.write("1.25 1.5 1 2\n2.25 1.5 1 2\n2.25 9.5 1 2\n")
        d.ctl("push", "t", b, c, "--columns", "xyzc", "--replace").ok()
        expect("others" not in job(), job())


def entries_of_the_log():
    """The log of a dataset: files, numbers, content hashes and names."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        a, b, c = (cloud(base, n, i, 0, 0, 50 + i) for i, n in enumerate(("a.las", "b.las", "c.las")))
        d.ctl("push", "s", a, b).ok()
        d.ctl("push", "s", c).ok()
        d.ctl("dataset", "revert", "s", "1").ok()
        rows = log(d, "s", "--files")
        expect([(r["generation"], r["kind"], r["files_added"], r["files_removed"], r["points_added"], r["points_removed"])
                for r in rows] == [(1, "push", 2, 0, 101, 0), (2, "push", 1, 0, 52, 0), (3, "revert", 0, 2, 0, 101)], "%s" % rows)
        expect(all(r["uid"] == os.getuid() and r["time"] and r["readable"] for r in rows), "%s" % rows)
        expect([[(f["path"], f["points"], f["removed"]) for f in r["files"]] for r in rows] == [
            [(a, 50, False), (b, 51, False)], [(c, 52, False)], [(a, 50, True), (b, 51, True)]], "%s" % rows)
        # The content of a generation is that of its files, whatever the order in which they came.
        d.ctl("push", "t", b).ok()
        d.ctl("push", "u", b, a).ok()
        expect(log(d, "u")[0]["content"] == rows[0]["content"] != log(d, "t")[0]["content"], "content hashes")
        expect(rows[2]["content"] == "0" * 32, "a generation that adds nothing has content")
        expect(all(f["hash"] and len(f["hash"]) == 32 for r in rows for f in r["files"]), "%s" % rows)
        text = d.ctl("dataset", "log", "s", "--files").ok().out
        expect("3\trevert of 1\tremoved\t%s\t50\t" % a in text, text)
        text = d.ctl("dataset", "log", "s").ok().out
        expect("3\trevert of 1\t" in text and "\t0\t0\t101\t2\t" in text, text)
        expect(log(d, "s")[0]["files"] is None, "files without --files")
        # A file from a pipe has the given name, and no path.
        with open(a, "rb") as f:
            p = subprocess.run([e2e.ACUTCTL, "--socket", d.socket, "push", "v", "-", "--input-format", "las", "--checksum", "--name", "T7"],
                               input=f.read(), stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        expect(p.returncode == 0, p.stderr)
        text = d.ctl("dataset", "log", "v", "--files").ok().out
        expect("\tadded\tT7\t50\t" in text and "stdin" not in text, text)
        says(d.ctl("dataset", "log", "nothing"), 4, "there is no dataset")


def content_of_a_large_file():
    """The hash of a file that several workers read is that of its bytes."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="1G", threads=4) as d:
        path = os.path.join(base, "a.las")
        e2e.run([e2e.SYNTH, "--points", "3M", path]).ok()
        with open(path, "rb") as f:
            content = xxhash.xxh3_128_hexdigest(f.read())
        for i in range(4):
            name = "s%d" % i
            d.ctl("push", name, path).ok()
            expect([f["hash"] for f in log(d, name, "--files")[0]["files"]] == [content], "the hash is not that of %s" % content)
        says(d.ctl("push", "s0", "--checksum", path, "--json"), 0, '"state":"known"')


def long_lists():
    """A generation with more files than fit into one message, and more generations than that."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="32M") as d:
        deep = os.path.join(base, *["x" * 200] * 15)
        os.makedirs(deep)
        one = cloud(base, "one.las", 1, 0, 0, 9)
        for i in range(150):
            shutil.copyfile(one, os.path.join(deep, "f%03d.las" % i))
        d.ctl("push", "s", deep).ok()
        rows = log(d, "s", "--files")
        expect([os.path.basename(f["path"]) for f in rows[0]["files"]] == ["f%03d.las" % i for i in range(150)], "files are missing")
        for i in range(70):
            d.ctl("dataset", "revert", "s").ok()
        rows = log(d, "s")
        expect([r["generation"] for r in rows] == list(range(1, 72)), "generations are missing: %d" % len(rows))
        expect(show(d, "s")["files"] == 150 and show(d, "s")["points"] == 1350, "%s" % show(d, "s"))


if __name__ == "__main__":
    e2e.main(classes_of_the_generation, entries_of_the_log, content_of_a_large_file, long_lists)
