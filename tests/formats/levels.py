"""A page with levels of detail: its tiles against the PLY of the same mesh, by fractions, without a browser; and in headless Chromium from a
disk and from a web server. With a folder as argument, pictures of it are kept there."""
import base64
import filecmp
import functools
import http.server
import json
import math
import os
import random
import re
import shutil
import sys
import threading
import zlib
from fractions import Fraction

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from chromium import Browser  # noqa: E402
from e2e import Daemon, Folder, expect, until  # noqa: E402
from reference import Reference  # noqa: E402

KEEP = sys.argv[1] if len(sys.argv) > 1 else None
TOLERANCE = 1e-9
PEAK = """import resource, subprocess, sys
subprocess.check_call(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"""
POINTS = 200000  # about 400,000 triangles
SIDE, LEAF = 128, 65536
TILE = re.compile(r'acutTile\("(\w+)","(\d+_\d+_\d+)",(\{.*?\}),`\n(.*?)`(?:,`\n(.*?)`)?\);\n', re.S)


def numbers(line):
    """Of a line of base64: seven bits a byte, the low ones first."""
    n, shift, out = 0, 0, []
    for byte in zlib.decompress(base64.b64decode(line), -15):
        n |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            out.append(n)
            n, shift = 0, 0
    return out


def signed(n):
    return -(n + 1) // 2 if n % 2 else n // 2


class Tile:
    def __init__(self, folder, levels, name, about):
        with open(os.path.join(folder, "tile_%s.js" % name)) as f:
            stamp, said, facts, first, second = TILE.fullmatch(f.read()).groups()
        expect(stamp == levels["stamp"] and said == name, "%s is said to be %s of %s" % (name, said, stamp))
        self.name, self.about, self.facts = name, about, json.loads(facts)
        self.depth, self.x, self.y = map(int, name.split("_"))
        self.size = 2 ** (levels["bits"] - self.depth)
        self.corner = [levels["low"][0] + self.x * self.size, levels["low"][1] + self.y * self.size]
        if about["grid"]:
            self.read_grid(numbers(first))
        else:
            self.read_leaf(first.split(), second.split())

    def read_leaf(self, vertices, faces):
        self.vertices, self.faces = [], []
        for line in vertices:
            n, *rest = numbers(line)
            columns = []
            for axis in range(3):
                value, column = 0, []
                for d in rest[axis * n:(axis + 1) * n]:
                    value += signed(d)
                    column.append(value)
                columns.append(column)
            self.vertices += zip(*columns)
        for line in faces:
            n, _, *rest = numbers(line)
            value = 0
            for i in range(n):
                value += rest[i]
                self.faces.append((value, value - rest[n + i], value - rest[2 * n + i]))
        expect(len(self.faces) == self.facts["triangles"] == self.about["triangles"] <= LEAF, "triangles of %s" % self.name)
        expect(len(self.vertices) == self.facts["vertices"] == len(set(self.vertices)), "vertices of %s" % self.name)
        box = [f(v[axis] for v in self.vertices) for f in (min, max) for axis in range(3)]
        expect(box == self.about["box"], "the box of %s is %s, not %s" % (self.name, box, self.about["box"]))

    def triangles(self):
        for face in self.faces:
            corners = [self.vertices[i] for i in face]
            for axis in (0, 1):
                centre = sum(c[axis] for c in corners) // 3
                expect(0 <= centre - self.corner[axis] < self.size, "%s has a triangle of another square" % self.name)
            least = corners.index(min(corners))
            yield tuple(corners[least:] + corners[:least])

    def read_grid(self, n):
        self.step, begin, at = self.size // SIDE, 0, iter(n)
        self.heights = {}
        for j in range(SIDE + 1):
            last, first = begin, True
            for i in range(SIDE + 1):
                d = next(at)
                if d:
                    last += signed(d - 1)
                    begin, first = last if first else begin, False
                    self.heights[i, j] = last

    def height(self, x, y):
        """Of the grid, at lattice numbers, as a fraction; None where it has no triangle."""
        u, v = (Fraction(n - c, self.step) for n, c in zip((x, y), self.corner))
        i, j = (min(SIDE - 1, math.floor(n)) for n in (u, v))
        a, c, b = (self.heights.get(at) for at in ((i, j), (i + 1, j + 1), (i + 1, j) if u - i >= v - j else (i, j + 1)))
        if None in (a, b, c):
            return None
        p, q = (u - i, v - j) if u - i >= v - j else (v - j, u - i)
        return a + p * (b - a) + q * (c - b)


class Tree:
    """All tiles of a folder."""

    def __init__(self, folder):
        with open(os.path.join(folder, "index.html")) as f:
            self.facts = json.loads(re.search(r'id="facts">(.*?)</script>', f.read())[1])
        self.levels, self.tiles = self.facts["levels"], []
        self.add(folder, "0_0_0", self.levels["root"])
        names = {"index.html"} | {"tile_%s.js" % t.name for t in self.tiles}
        expect(set(os.listdir(folder)) == names, "files that are in no tree: %s" % (set(os.listdir(folder)) ^ names))
        self.leaves, self.grids = ([t for t in self.tiles if t.about["grid"] == grid] for grid in (False, True))

    def add(self, folder, name, about):
        tile = Tile(folder, self.levels, name, about)
        self.tiles.append(tile)
        children = [c for c in tile.facts.get("children", []) if c]
        if about["grid"]:
            expect(sum(c["triangles"] for c in children) == about["triangles"] > LEAF, "triangles below %s" % name)
            for k in range(6):
                expect((min if k < 3 else max)(c["box"][k] for c in children) == about["box"][k], "the box of %s" % name)
        for i, child in enumerate(tile.facts.get("children", [])):
            if child:
                self.add(folder, "%d_%d_%d" % (tile.depth + 1, 2 * tile.x + i % 2, 2 * tile.y + i // 2), child)


class World:
    def __init__(self, base):
        self.base = base
        self.daemon = Daemon(base, memory="256M").start()
        survey = self.path("survey.las")
        e2e.run([e2e.SYNTH, "--points", str(POINTS), survey]).ok()
        self.daemon.ctl("push", "s", survey).ok()
        self.daemon.ctl("submit", "s", "--wait").ok()
        self.folder, self.ply = self.fetch("survey", "--levels"), self.fetch("survey.ply")
        self.page = os.path.join(self.folder, "index.html")
        self.mesh, self.tree = Reference(self.ply), Tree(self.folder)
        self.browser = None

    def done(self):
        if self.browser:
            self.browser.__exit__()
        self.daemon.__exit__(None, None, None)

    def path(self, name):
        return os.path.join(self.base, name)

    def fetch(self, name, *options):
        self.daemon.ctl("fetch", "1", "-o", self.path(name), *options).ok()
        return self.path(name)

    def show(self, url):
        if not self.browser:
            self.browser = Browser(self.base).__enter__()
            self.browser.size(860, 600)
        b = self.browser
        b.requests.clear()
        b.said.clear()
        b.call("Page.navigate", url=url)
        expect(b.ready(), b.said)
        return b


world = None


def keep(name):
    if KEEP:
        os.makedirs(KEEP, exist_ok=True)
        world.browser.picture(os.path.join(KEEP, name + ".png"))


def places(mesh, n, seed):
    """Coordinates (doubles) inside of the box of a mesh."""
    rng = random.Random(seed)
    low, high = ([float(f(v[axis] for v in mesh.vertices) * mesh.scale[axis]) for axis in (0, 1)] for f in (min, max))
    return [(rng.uniform(low[0], high[0]), rng.uniform(low[1], high[1])) for _ in range(n)]


def k_of(tree, mesh):
    """What is added to the lattice numbers of tiles: multiples of the scale in the PLY."""
    axes = tree.facts["axes"]
    return [int(Fraction(int(a["b"]), int(a["q"])) / s) for a, s in zip(axes, mesh.scale)]


def leaves_are_the_mesh_each_triangle_once():
    tree, mesh, k = world.tree, world.mesh, k_of(world.tree, world.mesh)
    got = [t for leaf in tree.leaves for t in leaf.triangles()]
    want = set()
    for face in mesh.faces:
        corners = [tuple(n - m for n, m in zip(mesh.vertices[i], k)) for i in face]
        least = corners.index(min(corners))
        want.add(tuple(corners[least:] + corners[:least]))
    expect(len(got) == len(want) and set(got) == want, "%d triangles, %d of the mesh" % (len(got), len(set(got) & want)))
    expect(tree.facts["triangles"] == len(mesh.faces) and tree.facts["vertices"] == len(mesh.vertices), "the counts of the page")
    size = sum(os.path.getsize(os.path.join(world.folder, f)) for f in os.listdir(world.folder))
    print("     %d leaves, %d grids, %.1f bytes a triangle" % (len(tree.leaves), len(tree.grids), size / len(mesh.faces)))


def check_grids(tree, mesh, n):
    k, rng = k_of(tree, mesh), random.Random(3)
    vertices = rng.sample(range(len(mesh.vertices)), n)
    worst = 0
    for grid in tree.grids:
        error, measured, seen = Fraction(grid.about["error"]), 0, 0
        for at in rng.sample([(i, j) for i in range(SIDE + 1) for j in range(SIDE + 1)], n):  # places of the grid
            x, y = (c + grid.step * i for c, i in zip(grid.corner, at))
            want = mesh.lattice_height(x + k[0], y + k[1])
            got = grid.heights.get(at)
            expect((want is None) == (got is None), "%s has %s at %s, the mesh %s" % (grid.name, got, at, want))
            expect(want is None or got == math.floor(want - k[2] + Fraction(1, 2)), "%s has %s at %s, the mesh %s" % (grid.name, got, at, want))
        probes = [tuple(Fraction(c) + Fraction(rng.randrange(grid.size * 1000), 1000) for c in grid.corner) for _ in range(n)]
        probes += [tuple(mesh.vertices[i][axis] - k[axis] for axis in (0, 1)) for i in vertices]
        for x, y in probes:
            if not all(0 <= p - c <= grid.size for p, c in zip((x, y), grid.corner)):
                continue
            got = grid.height(x, y)
            want = mesh.lattice_height(x + k[0], y + k[1]) if got is not None else None
            if want is not None:
                seen += 1
                measured = max(measured, abs(got + k[2] - want))
        expect(measured <= error, "%s is off by %s, and says %s" % (grid.name, float(measured), float(error)))
        worst = max(worst, float(measured / error))
        expect(seen or not grid.heights, "nothing of %s was seen" % grid.name)
    print("     %d grids, the worst place found has %.2f of the error" % (len(tree.grids), worst))


def grids_are_of_the_mesh_and_within_their_error():
    check_grids(world.tree, world.mesh, 1000)


def errors_are_those_of_the_worst_vertex_or_more():
    """Of the root: all vertices. The error is not much more than what they have."""
    root, mesh, k = world.tree.tiles[0], world.mesh, k_of(world.tree, world.mesh)
    worst, degree, lost = 0, [0] * len(mesh.vertices), 0
    for face in mesh.faces:
        for i in face:
            degree[i] += 1
    for v, n in zip(mesh.vertices, degree):
        got = root.height(v[0] - k[0], v[1] - k[1])
        worst = max(worst, abs(got + k[2] - v[2])) if got is not None else worst
        lost += n * (got is None)
    part = lost / 3 / len(mesh.faces)
    expect(0 < part <= root.about["lost"] < part + 0.0015, "%s of the corners are lost, it says %s" % (part, root.about["lost"]))
    expect(worst <= root.about["error"] <= 1.2 * float(worst), "the error is %s, at vertices %s" % (root.about["error"], float(worst)))


def holes_stay_holes():
    low = [float(min(v[axis] for v in world.mesh.vertices) * world.mesh.scale[axis]) for axis in (0, 1)]
    ring = [[low[0] + x, low[1] + y] for x, y in ((40, 40), (90, 50), (80, 100), (30, 90), (40, 40))]
    area = world.path("hole.geojson")
    with open(area, "w") as f:
        json.dump({"type": "Polygon", "coordinates": [ring]}, f)
    tree, mesh = Tree(world.fetch("hole", "--levels", "--erase", area)), Reference(world.fetch("hole.ply", "--erase", area))
    check_grids(tree, mesh, 300)
    b = world.show("file://" + world.path("hole/index.html"))
    expect(b.value("acut.exact(%r, %r).then(Number.isNaN)" % (low[0] + 60, low[1] + 70)), "the hole has a height")
    expect(b.value("Number.isNaN(acut.height(%r, %r))" % (low[0] + 60, low[1] + 70)), "the hole has a height from a grid")


def bytes_are_the_same_for_any_memory_and_threads():
    for memory, threads in (("24M", 1), ("24M", 4), ("1G", 4)):
        name = "-%s-%d" % (memory, threads)
        other = os.path.join(world.path("with" + name), "survey") # its name is in the page
        os.makedirs(os.path.dirname(other))
        with Daemon(world.base, memory=memory, threads=threads, name=name) as d:
            d.ctl("push", "s", world.path("survey.las")).ok()
            d.ctl("submit", "s", "--wait").ok()
            d.ctl("fetch", "1", "--levels", "-o", other).ok()
        same = filecmp.dircmp(world.folder, other)
        _, differ, errors = filecmp.cmpfiles(world.folder, other, os.listdir(world.folder), shallow=False)
        expect(not (differ or errors or same.left_only or same.right_only), "with %s and %d threads: %s" % (memory, threads, differ + errors))


def memory_is_bounded():
    """Of acutctl: 64 MiB for any mesh. This one has 19 MB of triangles, which are not all in memory at a time."""
    r = e2e.run([sys.executable, "-c", PEAK, e2e.ACUTCTL, "fetch", "1", "--levels", "-o", world.path("measured")], env={"ACUT_SOCKET": world.daemon.socket})
    peak = int(r.ok().out.splitlines()[-1])
    print("     acutctl had %.1f MiB" % (peak / 1024))
    expect(e2e.sanitized() or peak < 36 * 1024, "acutctl had %d KiB" % peak)


def what_cannot_be_is_refused():
    out, fetch = world.path("refused"), lambda *words: world.daemon.ctl("fetch", "1", "--levels", *words)
    for want, words in (("no meaning for ply", ["--format", "ply", "-o", out]), ("cannot go to standard output", ["-o", "-"]),
                        ("the name of a page", ["-o", out + ".html"]), ("no meaning with --tile", ["--tile", "100", "--format", "html", "-o", out]), ("one folder", ["-o", out, "-o", out + "2"]),
                        ("--sidecar has no meaning", ["--sidecar", "-o", out]), ("cannot be resumed with --levels", ["--resume", "-o", out]),
                        ("has tiles already", ["--no-clobber", "-o", world.folder])):
        r = fetch(*words)
        expect(r.status == 2 and want in r.err and not os.path.exists(out), "%s: %d %s" % (words, r.status, r.err))
    said = json.loads(fetch("--json", "-o", world.path("said/")).ok().out)["tiles"]
    expect(said == {"files": len(world.tree.tiles), "size": None, "folder": world.path("said/"), "index": world.path("said/index.html")}, said)


def heights_of_the_page(url, n):
    """From a disk or a server: what is drawn first is within what it says; then exact heights. Nothing is asked for but files of the folder."""
    b, mesh = world.show(url), world.mesh
    print("     ready after %.0f ms" % b.value("acut.milliseconds"))
    at = places(mesh, n, 5)
    text = ",".join("[%r,%r]" % p for p in at)
    coarse = b.value("[%s].map(([x, y]) => { const {page} = acut, at = [x, y].map((n, axis) => page.axes[axis].relative(n - page.axes[axis].base));"
                     " const {z, error} = page.surface.find(at[0], at[1]);"
                     " return [Number.isNaN(z) ? null : page.axes[2].base + page.axes[2].local(z), error * page.axes[2].step]; })" % text)
    b.value("(async () => { window.got = []; for (const [x, y] of [%s]) { const h = await acut.exact(x, y); got.push(Number.isNaN(h) ? null : h); } })()" % text)
    exact, after = b.value("got"), b.value("[%s].map(([x, y]) => { const h = acut.height(x, y); return Number.isNaN(h) ? null : h; })" % text)
    worst, inexact = 0, 0
    for (x, y), (z, error), h in zip(at, coarse, exact):
        want = mesh.height(x, y)
        expect((want is None) == (h is None), "at %r, %r: %r, not %s" % (x, y, h, want))
        if want is None:
            continue
        worst = max(worst, abs(Fraction(h) - want[0]))
        inexact += error > 0
        expect(z is None or abs(Fraction(z) - want[0]) <= Fraction(error) + Fraction(TOLERANCE), "at %r, %r: %r to within %s, not %s" % (x, y, z, error, float(want[0])))
    expect(worst <= TOLERANCE and after == exact, "a height is off by %g" % worst)
    expect(inexact > n / 4, "%d of %d heights were not exact at first" % (inexact, n))
    print("     %d heights, off by at most %.1e; %d were not exact at first" % (n, worst, inexact))
    folder = url.rsplit("/", 1)[0] + "/"
    names = {r[len(folder):] for r in b.requests if r.startswith(folder)}
    expect(len(names) > 2 and all(r.startswith(folder) for r in b.requests) and names <= set(os.listdir(world.folder)), b.requests)
    expect(b.said == [], b.said)


def from_a_disk():
    heights_of_the_page("file://" + world.page, 1000)


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args):
        pass


def from_a_web_server():
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=world.folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        heights_of_the_page("http://127.0.0.1:%d/index.html" % server.server_port, 200)
    finally:
        server.shutdown()
        server.server_close()


def all_leaves_in_the_page_are_the_mesh():
    b = world.show("file://" + world.page)
    b.value("(async () => { window.seen = {triangles: 0, names: []};"
            " await acut.page.surface.eachLeaf(() => true, t => { seen.triangles += t.mesh.faces.length / 3; seen.names.push(t.name); }); })()")
    seen = b.value("seen")
    expect(seen["triangles"] == len(world.mesh.faces) and sorted(seen["names"]) == sorted(t.name for t in world.tree.leaves), seen)


def closer_is_finer_and_far_tiles_are_forgotten():
    b = world.show("file://" + world.page)
    said, names = [], []
    for most, kept, factor in ((5e5, 1e6, 1), (5e5, 1e6, 0.1), (1e5, 1e5, 2), (1e5, 1e5, 5)):
        b.value("acut.page.surface.most = %r, acut.page.surface.kept = %r" % (most, kept))
        b.value("acut.page.camera.zoom(%r, null), acut.page.update(), acut.settled()" % factor)
        said.append(b.value("document.getElementById('legend-error').textContent").replace("\u00a0", " "))
        names.append(b.value("acut.page.surface.drawn.map(t => t.name)"))
        drawn, loaded = b.value("[acut.page.surface.drawn, [...acut.page.surface.loaded]].map(l => l.reduce((n, t) => n + t.triangles, 0))")
        expect(0 < drawn <= most and loaded < kept + most, "%d triangles are drawn, %d loaded" % (drawn, loaded))
    coarse = r"Drawn to within [0-9.]+ m\nUp to [0-9.]+ m may be missing at borders"
    expect(all(re.fullmatch(coarse, s) for s in (said[0], *said[2:])) and said[1] == "Drawn exactly", said)
    grids = [{t.name for t in world.tree.grids} & set(n) for n in names]
    expect(grids[0] and not grids[1] and grids[3], names)
    expect(b.said == [], b.said)


def a_profile_becomes_the_section():
    b, mesh, k = world.show("file://" + world.page), world.mesh, k_of(world.tree, world.mesh)
    b.value("acut.settled()")
    b.key("t")
    until(lambda: b.value("acut.page.camera.parallel"), "the key does nothing")
    b.value("document.getElementById('profile').click()")
    for x, y in ((330, 180), (560, 420)):
        b.click(x, y)
    until(lambda: b.value("acut.page.tools.error === 0 && acut.page.tools.line.length > 700"), "the profile does not become exact")
    keep("levels-profile")
    middle = [n + m for n, m in zip(b.value("acut.page.surface.middle"), k)]
    a, c = ([Fraction(n) + m for n, m in zip(place, middle)] for place in b.value("acut.page.tools.corners.profile"))
    for place in (a, c):
        want = mesh.lattice_height(*place[:2])
        expect(abs(place[2] - want) < 1e-6, "a corner is at %s, not %s" % (float(place[2]), float(want)))
    line = b.value("acut.profile()")
    want = mesh.section(a, c)
    length = math.hypot(*(float((n - m) * s) for n, m, s in zip(c[:2], a, mesh.scale)))
    expect(len(line) == len(want) + 2, "the profile has %d points, not %d" % (len(line), len(want) + 2))
    for (part, height), (distance, _, _, h) in zip(want, line[1:]):
        expect(abs(distance - float(part) * length) < TOLERANCE and abs(float(height - Fraction(h))) < TOLERANCE, "at %s the height is %s, not %s" % (distance, h, float(height)))
    print("     %d points" % len(line))
    expect("to within" not in b.value("document.getElementById('chart-facts').textContent"), "an exact profile says that it is not")


def a_pointer_that_rests_has_the_exact_height():
    b, mesh = world.show("file://" + world.page), world.mesh
    b.value("acut.settled()")
    place, error = b.value("(() => { const {page} = acut, at = page.placeAt([440, 330]); return [page.coordinates(at), page.surface.find(at[0], at[1]).error]; })()")
    expect(error > 0, "the place is exact before anything is there")
    b.mouse("Moved", 440, 330)
    text = "document.getElementById('cursor').textContent"
    until(lambda: re.search(r"H[0-9\u202f.]+ m$", b.value(text)), "the height stays coarse: " + b.value(text))
    said = float(re.search(r"H([0-9\u202f.]+) m$", b.value(text))[1].replace("\u202f", ""))
    want, steep = mesh.height(*place[:2])
    expect(abs(said - want) <= 0.0051 + steep * 1e-6, "%s is said, not %s" % (said, float(want)))


def displays_are_pictures():
    b = world.show("file://" + world.page)
    b.value("acut.page.camera.zoom(0.1, null), acut.page.update(), acut.settled()") # triangles are drawn of leaves
    seen = []
    for key in ("1", "2", "3", "c", "w"):
        b.key(key)
        b.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        picture = b.call("Page.captureScreenshot", format="png", clip={"x": 300, "y": 120, "width": 300, "height": 300, "scale": 1})["data"] # no card
        expect(picture not in seen, "%s changes nothing" % key)
        seen.append(picture)
        keep("levels-" + key)
    expect(b.value("acut.page.surface.drawn.length > 0 && acut.page.surface.drawn.every(t => !t.grid && t.part.lists.has('edges'))"), "edges are not drawn")
    expect(b.value("document.querySelector('[value=domains]').closest('label').hidden"), "there are domains")
    expect(b.said == [], b.said)


def a_tile_that_is_missing_or_of_another_mesh_is_said():
    copy = world.path("copy")
    shutil.copytree(world.folder, copy)
    leaf = os.path.join(copy, "tile_%s.js" % world.tree.leaves[0].name)
    message, load = "document.getElementById('message').innerText", "acut.page.surface.eachLeaf(() => true, () => {}).catch(e => acut.page.surface.fail(e))"
    with open(leaf) as f:
        text = f.read()
    with open(leaf, "w") as f:
        f.write(text.replace(world.tree.levels["stamp"], "0" * 16))
    b = world.show("file://" + os.path.join(copy, "index.html"))
    b.value(load)
    expect("is of another mesh" in b.value(message), b.value(message))
    os.remove(leaf)
    b = world.show("file://" + os.path.join(copy, "index.html"))
    b.value(load)
    expect("is not beside the page" in b.value(message), b.value(message))


def the_policy_forbids_all_but_files_of_the_folder():
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=world.folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    other = "http://127.0.0.1:%d/tile_0_0_0.js" % server.server_port
    try:
        b = world.show("file://" + world.page)
        expect(b.value("fetch('%s').then(() => 'came', e => String(e))" % other).startswith("TypeError"), "a request goes out")
        came = b.value("new Promise(done => { const s = document.createElement('script'); s.onload = () => done('came'); s.onerror = () => done('refused');"
                       " s.src = '%s'; document.head.append(s); })" % other)
        expect(came == "refused", "a script of another place runs")
    finally:
        server.shutdown()
        server.server_close()


def main():
    global world
    if not shutil.which("chromium"):
        e2e.unavailable("chromium is not installed (chromium)")
    with Folder() as base:
        world = World(base)
        try:
            e2e.main(leaves_are_the_mesh_each_triangle_once, grids_are_of_the_mesh_and_within_their_error, errors_are_those_of_the_worst_vertex_or_more,
                     holes_stay_holes, bytes_are_the_same_for_any_memory_and_threads, memory_is_bounded, what_cannot_be_is_refused, from_a_disk, from_a_web_server,
                     all_leaves_in_the_page_are_the_mesh, closer_is_finer_and_far_tiles_are_forgotten, a_profile_becomes_the_section, a_pointer_that_rests_has_the_exact_height,
                     displays_are_pictures,
                     a_tile_that_is_missing_or_of_another_mesh_is_said, the_policy_forbids_all_but_files_of_the_folder)
        finally:
            world.done()


main()
