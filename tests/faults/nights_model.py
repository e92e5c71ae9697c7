"""For nights.py: what people deliver into a drop folder, and an independent model of what must then be in the dataset. The model
asks acut nothing: it knows which files were made whole and which were not, and follows acut-ingest(8)."""
import collections
import os
import struct

import faults
from faults import expect

Content = collections.namedtuple("Content", "path points size")  # points None: it is to be refused


def write_las(path, points):
    """LAS 1.2, point format 0, in hundredths."""
    low, high = [[f(p[k] for p in points) / 100 for k in range(3)] for f in (min, max)]
    h = bytearray(227)
    h[0:4], h[24], h[25] = b"LASF", 1, 2
    struct.pack_into("<HII", h, 94, 227, 227, 0)
    struct.pack_into("<HI", h, 105, 20, len(points))
    struct.pack_into("<3d", h, 131, .01, .01, .01)
    for k in range(3):
        struct.pack_into("<2d", h, 179 + 16 * k, high[k], low[k])
    with open(path, "wb") as f:
        f.write(bytes(h) + b"".join(struct.pack("<iiiHBBbBH", *p, 0, 9, 2, 0, 0, 0) for p in points))


class Drop:
    """A drop folder and the dataset that it fills. `live` is the model: the number of the content of each file of the dataset."""

    def __init__(self, base, rng, dataset):
        self.rng, self.dataset, self.live, self.replace = rng, dataset, {}, False
        self.folder, self.kept = os.path.join(base, "drop-" + dataset), os.path.join(base, "kept-" + dataset)
        os.mkdir(self.folder)
        os.mkdir(self.kept)
        self.contents, self.waiting, self.taken, self.refused, self.unfinished = [], {}, 0, 0, 0

    # ---- deliveries ----

    def content(self, points):
        """A new file of points, or a damaged one; its number. It is kept outside of the drop folder."""
        rng, number = self.rng, len(self.contents)
        path = os.path.join(self.kept, "%d.las" % number)
        write_las(path, [(rng.randrange(20000), rng.randrange(20000), rng.randrange(3000)) for _ in range(points or 50)])
        if not points:
            if rng.random() < .5:
                os.truncate(path, os.stat(path).st_size - rng.randrange(1, 900))
            else:
                with open(path, "wb") as f:
                    f.write(b"%%PDF-1.4 no points %d" % number)
        self.contents.append(Content(path, points, os.stat(path).st_size))
        return number

    def put(self, name, number):
        """As acut-ingest(8) asks: under another name first."""
        path = os.path.join(self.folder, name)
        with open(self.contents[number].path, "rb") as f, open(path + ".part", "wb") as to:
            to.write(f.read())
        os.rename(path + ".part", path)
        self.waiting[name] = number

    def deliver(self, night):
        rng, self.replace = self.rng, False
        for i in range(rng.randrange(1, 4)):
            self.put("n%03d-%d.las" % (night, i), self.content(rng.randrange(100, 600)))
        names = sorted(self.live)
        if rng.random() < .2:
            self.put("n%03d-bad.las" % night, self.content(None))
        if names and rng.random() < .25:  # once more, under another name
            self.put("n%03d-again.las" % night, self.live[rng.choice(names)])
        elif names and rng.random() < .3:  # other content under a name that the dataset has
            self.replace = rng.random() < .6
            self.put(rng.choice(names), self.content(rng.randrange(100, 600)))
        if rng.random() < .1:
            with open(os.path.join(self.folder, "n%03d-half.las.part" % night), "wb") as f:
                f.write(b"LASF")
            self.unfinished += 1
        if rng.random() < .05:  # nothing comes
            for name in list(self.waiting):
                os.unlink(os.path.join(self.folder, name))
            self.waiting = {}

    # ---- what a pass does ----

    def is_refused(self, name):
        number = self.waiting[name]
        return self.contents[number].points is None or (self.live.get(name, number) != number and not self.replace)

    def status(self):
        """The exit status of a whole pass over what lies in the folder now, after passes that were cut short."""
        there = [n for n in self.waiting if os.path.exists(os.path.join(self.folder, n))]
        bad = sum(map(self.is_refused, there))
        return 0 if not bad else 3 if bad < len(there) else 1

    def settle(self):
        """After a whole pass: the model has what it took, and the folder is in order."""
        for name, number in sorted(self.waiting.items()):
            if self.is_refused(name):
                self.refused += 1
                continue
            self.taken += 1
            if number not in self.live.values():
                self.live[name] = number
        self.waiting = {}
        left, done, failed = (os.listdir(os.path.join(self.folder, d)) if os.path.isdir(os.path.join(self.folder, d)) else []
                              for d in (".", "done", "failed"))
        left = [n for n in left if n not in ("done", "failed")]
        expect(len(left) == self.unfinished and all(n.endswith(".part") for n in left), "left in the folder: %s" % left)
        expect(len(done) == self.taken, "%d files in done/, not %d" % (len(done), self.taken))
        refused = [n for n in failed if not n.endswith(".error")]
        expect(len(refused) == self.refused and all(n + ".error" in failed for n in refused),
               "%d files in failed/, not %d: %s" % (len(refused), self.refused, sorted(failed)))

    # ---- what must be there ----

    def points(self):
        return sum(self.contents[n].points for n in self.live.values())

    def paths(self):
        return [self.contents[n].path for n in self.live.values()]

    def check(self, ctl):
        """Compares with `dataset log --files`: nothing lost, nothing doubled, nothing else."""
        want = sorted((name, self.contents[n].points, self.contents[n].size) for name, n in self.live.items())
        if not want:
            return
        got = {}
        for generation in map(faults.json.loads, ctl("dataset", "log", self.dataset, "--files", "--json").ok().out.splitlines()):
            for f in generation["files"]:
                expect(f["removed"] or f["source"] not in got, "source %d twice" % f["source"])
                if f["removed"]:
                    got.pop(f["source"], None)  # pruned away, perhaps
                else:
                    got[f["source"]] = (f["name"], f["points"], f["bytes"])
        got = sorted(got.values())
        lost, more = collections.Counter(want) - collections.Counter(got), collections.Counter(got) - collections.Counter(want)
        expect(not lost and not more, "%s: lost %s, doubled or unknown %s" % (self.dataset, list(lost), list(more)))
        shown = ctl("dataset", "show", self.dataset, "--json").ok().json()
        expect((shown["files"], shown["points"], shown["pending"]) == (len(want), self.points(), None), "%s: %s" % (self.dataset, shown))
