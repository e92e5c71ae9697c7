"""The page of a mesh in headless Chromium, against the PLY of the same mesh: heights and profiles by fractions, displays, contours, touch, and
that no request leaves it. With a folder as argument, pictures of it are kept there."""
import math
import os
import random
import re
import shutil
import sys
from fractions import Fraction

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from chromium import Browser  # noqa: E402
from e2e import Daemon, Folder, expect, until  # noqa: E402
from foreign import read_ply  # noqa: E402
from reference import Reference  # noqa: E402

KEEP = sys.argv[1] if len(sys.argv) > 1 else None
TOLERANCE = 1e-9


class World:
    """A daemon with a mesh of some domains, its pages, and a browser; made once."""

    def __init__(self, base):
        self.base = base
        self.daemon = Daemon(base, memory="24M").start()
        survey = self.path("survey.las")
        e2e.run([e2e.SYNTH, "--points", "40000", survey]).ok()
        self.daemon.ctl("push", "s", survey).ok()
        self.daemon.ctl("submit", "s", "--wait").ok()
        self.page, self.ply = self.fetch("survey.html"), self.fetch("survey.ply")
        self.mesh = Reference(self.ply)
        self.browser = Browser(base).__enter__()
        self.browser.size(860, 600)

    def done(self):
        self.browser.__exit__()
        self.daemon.__exit__(None, None, None)

    def path(self, name):
        return os.path.join(self.base, name)

    def fetch(self, name, *options):
        self.daemon.ctl("fetch", "1", "-o", self.path(name), *options).ok()
        return self.path(name)

    def show(self, path):
        self.browser.open(path)
        expect(self.browser.ready(), self.browser.said)
        return self.browser


world = None


def keep(name):
    if KEEP:
        os.makedirs(KEEP, exist_ok=True)
        world.browser.picture(os.path.join(KEEP, name + ".png"))


def the_page_is_ready_and_asks_for_nothing():
    b = world.show(world.page)
    print("     ready after %.0f ms, %d triangles, %.1f bytes each" %
          (b.value("acut.milliseconds"), len(world.mesh.faces), os.path.getsize(world.page) / len(world.mesh.faces)))
    expect(b.said == [], b.said)
    expect(b.requests == ["file://" + world.page], b.requests)
    expect(b.value("document.title") == "survey" and b.value("document.getElementById('title').textContent") == "survey", "the title")
    domains = b.value("acut.page.mesh.domains.length")
    expect(domains > 1, "%d domains" % domains)


def heights_equal(path, ply, n):
    b, mesh, rng = world.show(path), Reference(ply) if ply != world.ply else world.mesh, random.Random(7)
    low, high = ([float(f(v[axis] for v in mesh.vertices) * mesh.scale[axis]) for axis in (0, 1)] for f in (min, max))
    places = [(rng.uniform(low[0] - 1, high[0] + 1), rng.uniform(low[1] - 1, high[1] + 1)) for _ in range(n)]
    for _ in range(n // 5):  # corners, and middles of edges
        u, v = (mesh.vertices[i] for i in rng.choice(mesh.faces)[:2])
        places += [(float(u[0] * mesh.scale[0]), float(u[1] * mesh.scale[1])), (float((u[0] + v[0]) * mesh.scale[0] / 2), float((u[1] + v[1]) * mesh.scale[1] / 2))]
    got = b.value("[%s].map(([x, y]) => { const h = acut.height(x, y); return Number.isNaN(h) ? null : h; })" % ",".join("[%r,%r]" % p for p in places))
    inside, worst = 0, 0
    for (x, y), h in zip(places, got):
        want = mesh.height(x, y)
        expect((want is None) == (h is None), "at %r, %r: %r, not %s" % (x, y, h, want))
        if want is None:
            continue
        inside += 1
        worst = max(worst, abs(Fraction(h) - want[0]))
    expect(inside > n, "only %d places are inside" % inside)
    expect(worst <= TOLERANCE, "a height is off by %g" % worst)
    print("     %d heights, off by at most %.1e" % (inside, worst))


def heights_are_those_of_the_mesh():
    heights_equal(world.page, world.ply, 1000)


def heights_in_feet_and_from_an_origin():
    """Whose coordinates are no decimals in the end: PLY has the nearest doubles, so the page is compared with these."""
    options = ["--origin", "500000,5400000,3.5", "--z-unit", "ft"]
    b, mesh = world.show(world.fetch("feet.html", *options)), world.mesh
    vertices, faces = read_ply(world.fetch("feet.ply", *options))
    used = sorted({i for f in random.Random(3).sample(faces, 200) for i in f})
    got = b.value("[%s].map(([x, y]) => acut.height(x, y))" % ",".join("[%r,%r]" % vertices[i][:2] for i in used))
    # An x that is rounded is beside the vertex, by 1e-11 at most, so a cliff counts.
    worst = max(abs(h - vertices[i][2]) for h, i in zip(got, used))
    expect(worst <= 1e-8, "a height is off by %g" % worst)
    expect("ft" in b.value("document.getElementById('legend-title').textContent"), "the unit")
    ends = [float(f(v[2] for v in vertices)) for f in (min, max)]
    said = b.value("document.getElementById('legend-lines').textContent").replace("\u202f", "")
    expect(said == "%.2f to %.2f ft" % tuple(ends), "%s are said to be %s" % (ends, said))
    expect(len(mesh.vertices) == len(vertices), "vertices")


def degrees_from_an_origin_are_as_long_as_before():
    with open(world.path("degrees.xyz"), "w") as f:
        f.write("".join("%.3f %.3f %d\n" % (13 + x / 1000, 52 + y / 1000, 10 + x + y) for x in range(3) for y in range(3)))
    for name, options in (("degrees", []), ("degrees-from", ["--origin", "13,52,0"])):
        world.daemon.ctl("mesh", world.path("degrees.xyz"), "--assume-crs", "EPSG:4326", "--planar", "-o", world.path(name + ".html"), *options).ok()
        step = world.show(world.path(name + ".html")).value("acut.page.step")
        want = 111.32 * math.cos(math.radians(52.001))
        expect(math.isclose(step[0], want, rel_tol=1e-4) and math.isclose(step[1], 111.32), "%s: steps of %s, not %s" % (name, step, want))


# How many triangles the grid lists, how many of them the fullest and the usual cell of a vertex has; the edges, and how many differ.
INDEX = """(() => {
    const {surface, mesh, scene} = acut.page, {start, list} = surface, gl = scene.gl, found = {triangles: surface.count, list: list.length};
    const sizes = Array.from({length: mesh.vertices.length / 3}, (_, i) => {
        const cell = surface.row(mesh.vertices[3 * i + 1] - surface.middle[1]) * surface.columns + surface.column(mesh.vertices[3 * i] - surface.middle[0]);
        return start[cell + 1] - start[cell];
    }).sort((a, b) => a - b);
    found.usual = sizes[sizes.length >> 1];
    const {part} = acut.page.items[0];
    scene.use(part);
    const edges = new Uint32Array(scene.edges(part).count);
    gl.getBufferSubData(gl.ELEMENT_ARRAY_BUFFER, 0, edges);
    found.edges = edges.length / 2;
    found.different = new Set(Array.from({length: found.edges}, (_, i) => edges[2 * i] * 2 ** 26 + edges[2 * i + 1])).size;
    found.vertices = mesh.vertices.length / 3;
    return found;
})()"""


def shapes_that_are_unlike_a_survey():
    rng, n = random.Random(5), 50000
    shapes = {"fan": [(i, 0, i % 100) for i in range(n)] + [(n // 3, n // 10, 50)],
              "outlier": [(0, 0, 0)] + [(500000 + rng.randrange(50000) / 100, 5400000 + rng.randrange(50000) / 100, rng.randrange(100)) for _ in range(n)]}
    for name, points in shapes.items():
        with open(world.path(name + ".xyz"), "w") as f:
            f.writelines("%s %s %s\n" % p for p in points)
        world.daemon.ctl("mesh", world.path(name + ".xyz"), "-o", world.path(name + ".html")).ok()
        b = world.show(world.path(name + ".html"))
        before = b.seconds()
        b.value("acut.page.toggle('wire'), acut.page.draw()")
        took, found = b.seconds() - before, b.value(INDEX)
        print("     %s: edges took %.2f s of CPU time, %s" % (name, took, found))
        expect(found["list"] <= 8 * found["triangles"] + 1000, "the grid of %s is too long: %s" % (name, found))
        expect(found["edges"] == found["different"] == found["triangles"] + found["vertices"] - 1, "edges of %s: %s" % (name, found))
        expect(took < 1.2, "edges take %.2f s of CPU time" % took)
        expect(name == "fan" or found["usual"] < 30, "a cell of %s has too many triangles: %s" % (name, found))


def places_of(b, corners):
    """Pixels of coordinates."""
    return [b.value("acut.pixel(%r, %r)" % c) for c in corners]


def a_profile_by_clicks_is_the_section():
    b, mesh = world.show(world.page), world.mesh
    b.key("t")
    until(lambda: b.value("acut.page.camera.parallel"), "the key does nothing")
    low, high = ([f(v[axis] for v in mesh.vertices) * mesh.scale[axis] for axis in (0, 1)] for f in (min, max))
    corners = [tuple(float(l + (h - l) * Fraction(part)) for l, h, part in zip(low, high, parts)) for parts in (("0.3", "0.35"), ("0.62", "0.41"), ("0.5", "0.7"))]
    b.value("document.getElementById('profile').click()")
    for corner in corners:
        b.click(*places_of(b, [corner])[0]) # a chart that opens may move what lies below it
        got = b.value("acut.page.coordinates(acut.page.tools.corners.profile.at(-1))")
        pixel = b.value("acut.page.camera.pixel()")
        expect(max(abs(g - c) for g, c in zip(got, corner)) < 1.5 * pixel, "a click at %s is %s" % (corner, got))
        want, steep = mesh.height(*got[:2])
        expect(abs(Fraction(got[2]) - want) <= TOLERANCE * (1 + steep), "the height of a click is off")
    b.mouse("Moved", 500, 600)
    keep("profile")
    # Clicks are places between lattice numbers, relative to the middle of the mesh: no digit is lost on the way to here.
    middle = [n + int(axis["b"]) // int(axis["a"]) for n, axis in zip(b.value("acut.page.surface.middle"), b.value("acut.page.mesh.facts.axes"))]
    clicked = [[Fraction(n) + m for n, m in zip(place, middle)] for place in b.value("acut.page.tools.corners.profile")]
    line, before, at = b.value("acut.profile()"), 0.0, 0
    for a, c in zip(clicked, clicked[1:]):
        length = math.hypot(*(float((n - m) * s) for n, m, s in zip(c[:2], a, mesh.scale)))
        want = [(0, a[2] * mesh.scale[2]), *mesh.section(a, c), (1, c[2] * mesh.scale[2])]
        for (part, height), (distance, _, _, h) in zip(want, line[at:at + len(want)]):
            expect(abs(distance - before - float(part) * length) < TOLERANCE, "a point at %s, not %s" % (distance, before + float(part) * length))
            expect(abs(float(height - Fraction(h))) < TOLERANCE, "at %s the height is %s, not %s" % (distance, h, float(height)))
        before, at = before + length, at + len(want)
    expect(at == len(line), "the profile has %d points, not %d" % (len(line), at))
    print("     %d points" % at)
    expect(b.value("!document.getElementById('chart').hidden"), "there is no chart")
    csv = b.value("acut.page.tools.csv()").splitlines()
    expect(csv[0] == "distance,easting,northing,height" and len(csv) == at + 1, csv[:2])
    b.key("Escape")
    b.key("Escape")
    expect(b.value("document.getElementById('chart').hidden"), "the chart stays")


def a_distance_by_clicks():
    b, mesh = world.show(world.page), world.mesh
    b.key("d")
    middle = [float(sum(v[axis] for v in mesh.vertices) * mesh.scale[axis] / len(mesh.vertices)) for axis in (0, 1)]
    corners = [tuple(middle), (middle[0] + 12, middle[1] - 5)]
    for x, y in places_of(b, corners):
        b.click(x, y)
        b.click(x, y)
    expect(b.value("acut.page.tools.corners.distance.length") == 2, "a double click is two corners")
    (ax, ay, az), (bx, by, bz) = (b.value("acut.page.coordinates(acut.page.tools.corners.distance[%d])" % i) for i in range(2))
    plan = ((bx - ax) ** 2 + (by - ay) ** 2) ** 0.5
    said = b.value("document.getElementById('measure-list').innerText").replace("\u00a0", " ").replace("\u202f", "")
    expect("%.2f m" % plan in said and "%.2f m" % (plan ** 2 + (bz - az) ** 2) ** 0.5 in said, "%s: %s" % (plan, said))
    keep("distance")


# A triangle of each domain from above: how much of its colour is red, and how much green. Light does not change that.
DOMAINS = """(() => {
    const page = acut.page, canvas = document.getElementById("scene"), gl = canvas.getContext("webgl2"), bytes = new Uint8Array(4);
    page.view("top");
    page.chooseMode(3);
    page.draw();
    return page.mesh.domains.map(domain => {
        const c = page.surface.load(domain.ranges[0][0] + (domain.ranges[0][1] >> 1)), middle = [0, 1, 2].map(axis => (c[axis] + c[3 + axis] + c[6 + axis]) / 3);
        const [x, y] = page.camera.project(middle);
        gl.readPixels(Math.floor(x), canvas.height - 1 - Math.floor(y), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
        const sum = bytes[0] + bytes[1] + bytes[2];
        return [bytes[0] / sum, bytes[1] / sum];
    });
})()"""


PICTURE = """(() => {
    acut.page.draw();
    const canvas = document.getElementById("scene"), gl = canvas.getContext("webgl2"), n = canvas.width * canvas.height, bytes = new Uint8Array(4 * n);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    let drawn = 0, hash = 0;
    for (let i = 0; i < bytes.length; i++) {
        drawn += i % 4 === 3 && bytes[i] > 0;
        hash = Math.imul(hash ^ bytes[i], 16777619);
    }
    return [drawn / n, hash];
})()"""


def each_display_is_another_picture():
    b, seen = world.show(world.page), {}
    for name, act in (("hillshade", "acut.page.chooseMode(0)"), ("elevation", "acut.page.chooseMode(1)"), ("slope", "acut.page.chooseMode(2)"),
                      ("domains", "acut.page.chooseMode(3)"), ("contours", "acut.page.chooseMode(1), acut.page.toggle('contours')"),
                      ("triangles", "acut.page.toggle('contours'), acut.page.toggle('wire')"),
                      ("higher", "acut.page.toggle('wire'), document.getElementById('height').value = 5, acut.page.changed()"),
                      ("from above", "acut.page.view('top')")):
        b.value(act)
        drawn, picture = b.value(PICTURE)
        expect(0.05 < drawn < 1, "%s: %.2f of the picture are drawn" % (name, drawn))
        expect(picture not in seen, "%s looks like %s" % (name, seen.get(picture)))
        seen[picture] = name
        keep(name)
    expect(b.said == [], b.said)


def each_domain_has_a_colour():
    colours = world.show(world.page).value(DOMAINS)
    for i, c in enumerate(colours):
        expect(all(math.dist(c, d) > 0.05 for d in colours[:i]), "two domains have one colour: %s" % colours)


# Pixels that contours change, and the heights of all. A contour goes by between two pixels if a multiple of the interval is between their
# heights. A line is some pixels wide, and of the plane that it is on, so some of it lie beyond the end of that plane.
CONTOURS = """(() => {
    const page = acut.page, canvas = document.getElementById("scene"), gl = canvas.getContext("webgl2"), w = canvas.width, h = canvas.height;
    const read = () => {
        const bytes = new Uint8Array(4 * w * h);
        page.draw();
        gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
        return bytes;
    };
    page.view("top");
    page.camera.zoom(0.4, null);
    const without = read();
    page.toggle("contours");
    const interval = page.scene.state.interval, lines = read(), heights = new Float64Array(w * h);
    for (let i = 0; i < w * h; i++) {
        const place = acut.place(i % w + 0.5, h - 1 - Math.floor(i / w) + 0.5);
        heights[i] = place ? place[2] / interval : NaN;
    }
    const differ = i => [0, 1, 2].some(k => Math.abs(lines[4 * i + k] - without[4 * i + k]) > 24);
    const near = (i, r) => {
        let low = Infinity, high = -Infinity;
        for (let y = -r; y <= r; y++) {
            for (let x = -r; x <= r; x++) {
                const v = heights[i + y * w + x];
                if (Number.isNaN(v))
                    return null;
                low = Math.min(low, v);
                high = Math.max(high, v);
            }
        }
        return Math.floor(low) < Math.floor(high) && high - low < 0.8 ? "level" : Math.floor(low) < Math.floor(high) ? "many" : "none";
    };
    const found = {lines: 0, false: 0, levels: 0, missing: 0, interval};
    for (let y = 3; y < h - 3; y++) {
        for (let x = 3; x < w - 3; x++) {
            const i = y * w + x, wide = near(i, 3), close = near(i, 1);
            if (wide && differ(i)) {
                found.lines++;
                found.false += wide === "none";
            }
            if (close === "level" && wide === "level") {
                found.levels++;
                let any = false;
                for (let v = -2; v <= 2; v++)
                    for (let u = -2; u <= 2; u++)
                        any = any || differ(i + v * w + u);
                found.missing += !any;
            }
        }
    }
    return found;
})()"""


def contours_are_at_true_heights():
    b = world.browser
    b.size(420, 320)
    world.show(world.page)
    found = b.value(CONTOURS)
    b.size(860, 600)
    expect(found["lines"] > 300 and found["levels"] > 300, found)
    expect(found["false"] <= 0.06 * found["lines"] and found["missing"] <= 0.02 * found["levels"], found)
    print("     %s" % found)


def keys_act_after_a_control_was_used():
    b = world.show(world.page)
    for control, key, state, want in (("[value=hillshade]", "3", "acut.page.scene.state.mode", 2), ("#interval", "w", "acut.page.scene.state.wire", True),
                                      ("#height", "t", "acut.page.camera.parallel", True)):
        b.value("document.querySelector('%s').disabled = false, document.querySelector('%s').focus()" % (control, control))
        b.key(key)
        until(lambda: b.value(state) == want, "%s does nothing at %s" % (key, control))
    target = "acut.page.camera.target.map(String)"
    before = b.value(target)
    b.key("ArrowLeft")
    expect(b.value(target) == before, "an arrow key of a slider moves the mesh")
    b.value("document.getElementById('scene').focus()")
    b.key("ArrowLeft")
    until(lambda: b.value(target) != before, "an arrow key does nothing")


def a_window_that_changes_shows_the_whole_mesh():
    b, camera = world.show(world.page), "(c => [c.distance, ...c.target].map(String))(acut.page.camera)"
    whole = b.value(camera)
    b.size(500, 600)
    until(lambda: b.value("acut.page.camera.width") == 500, "the size")
    expect(b.value(camera) != whole, "the mesh does not fit")
    b.value("acut.page.camera.zoom(0.7, null)")
    mine = b.value(camera)
    b.size(860, 600)
    until(lambda: b.value("acut.page.camera.width") == 860, "the size")
    expect(b.value(camera) == mine, "a view that was chosen is lost")
    b.key("r")
    until(lambda: b.value(camera) == whole, "R shows %s, not %s" % (b.value(camera), whole))


def light_and_dark():
    b = world.browser
    backs = []
    for scheme in ("light", "dark"):
        b.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        world.show(world.page)
        backs.append(b.value("getComputedStyle(document.documentElement).getPropertyValue('--back')"))
        keep(scheme)
    b.key("l")
    until(lambda: b.value("getComputedStyle(document.documentElement).getPropertyValue('--back')") == backs[0], "the key does nothing")
    expect(backs[0] != backs[1], backs)
    b.call("Emulation.setEmulatedMedia", features=[])


OUTSIDE = """[...document.querySelectorAll(".card")].filter(e => { const r = e.getBoundingClientRect();
    return r.width && (r.left < 0 || r.right > innerWidth || r.top < 0 || r.bottom > innerHeight); }).map(e => e.id)"""


# Cards that one sees and that are beyond the border, or over one another.
OVERLAPS = """[...document.querySelectorAll(".card")].filter(e => e.checkVisibility({visibilityProperty: true})).flatMap((e, i, all) => {
    const r = e.getBoundingClientRect(), name = e.id + " " + [r.left, r.top, r.right, r.bottom].map(Math.round);
    const over = all.slice(i + 1).filter(f => (s => Math.min(r.right, s.right) - Math.max(r.left, s.left) > 0.5 && Math.min(r.bottom, s.bottom) - Math.max(r.top, s.top) > 0.5)(f.getBoundingClientRect()));
    return [...over.map(f => name + " and " + f.id), ...(r.left < 0 || r.right > innerWidth || r.top < 0 || r.bottom > innerHeight ? [name] : [])];
})"""


def no_card_lies_over_another():
    b = world.show(world.page)
    b.value("acut.page.chooseMode(1), acut.page.toggle('contours')")
    if not KEEP:
        b.value("acut.page.scene.draw = () => {}") # takes most of the time
    profile = "tools.corners.profile = [surface.low, surface.high].map(c => c.map(n => n / 2)), tools.changed()"
    states = {"nothing": "1", "panel": "p.panel(true)", "a tool": "p.panel(false), tools.choose('distance')", "distance": profile.replace("profile", "distance"),
              "tool profile": "tools.choose('profile')", "profile": profile, "profile and panel": "p.panel(true)"}
    found = []
    for width, height in ((960, 540), (1024, 500), (1366, 768), (721, 481), (568, 320), (667, 375), (740, 360), (320, 568), (360, 740)):
        b.size(width, height, mobile=min(width, height) <= 375)
        for state, act in states.items():
            b.value("(({tools, surface, ...p}) => { p = acut.page; %s; })(acut.page)" % act)
            found += ["%d x %d, %s: %s" % (width, height, state, o) for o in b.value(OVERLAPS)]
        if height < 600:
            keep("size-%d-%d" % (width, height))
            expect(b.value("(e => { e.scrollIntoView(); const r = e.getBoundingClientRect(); return document.elementFromPoint(r.left + r.width / 2, r.top + r.height / 2) === e; })(document.getElementById('height'))"),
                   "%d x %d: the slider cannot be reached" % (width, height))
        b.value("acut.page.panel(false), acut.page.escape(), acut.page.escape()")
    b.size(860, 600)
    expect(not found, "\n".join(found))


def the_bar_shows(b, place):
    """With the next frame."""
    both = lambda: b.value("[document.getElementById('cursor').textContent.replace(/\\s/g, ''), acut.page.coordinates(%s)]" % place)
    until(lambda: (lambda said, want: said.startswith("E%.2fN%.2f" % tuple(want[:2])))(*both()), lambda: "the bar shows %s, not %s" % tuple(both()))


def a_telephone():
    b = world.browser
    b.size(360, 740, mobile=True)
    world.show(world.page)
    expect(b.value("document.documentElement.scrollWidth") <= 360, "it scrolls")
    expect(b.value(OUTSIDE) == [], b.value(OUTSIDE))
    camera = lambda: b.value("(c => [c.yaw, c.pitch, c.distance, ...c.target])(acut.page.camera)")
    before = camera()
    b.touch("Start", (180, 350))
    for x in (190, 210, 240):
        b.touch("Move", (x, 350))
    b.touch("End")
    turned = camera()
    expect(turned[0] != before[0], "one finger does not turn it")
    b.value("acut.page.view('reset')")
    before, place = camera(), b.value("acut.place(180, 400)")
    b.touch("Start", (150, 400), (210, 400))
    for d in (10, 25, 40):
        b.touch("Move", (150 + d, 400 + d), (210 + d, 400 + d))
    b.touch("End")
    moved, now = camera(), b.value("acut.pixel(%r, %r)" % tuple(place[:2]))
    expect(abs(moved[0] - before[0]) < 0.02 and math.hypot(now[0] - 220, now[1] - 440) < 15, "two fingers move it from 180, 400 to %s" % now)
    b.touch("Start", (150, 350), (210, 350))
    for d in (10, 25, 40):
        b.touch("Move", (150 - d, 350), (210 + d, 350))
    b.touch("End")
    expect(camera()[2] < 0.8 * moved[2], "two fingers do not bring it closer")
    b.value("acut.page.view('reset')")
    b.touch("Start", (180, 380))
    b.touch("End")
    until(lambda: re.search(r"E\s*\d", b.value("document.getElementById('cursor').textContent")), "a touch shows no coordinates")
    b.value("acut.page.camera.pan(30, -50), acut.page.draw()")
    the_bar_shows(b, "acut.page.pinned")
    for button in ("layers", "profile"):
        b.value("document.getElementById('%s').click()" % button)
        expect(b.value(OUTSIDE) == [], "beyond the border: %s" % b.value(OUTSIDE))
        keep("telephone-" + button)
    b.value("acut.page.panel(false)")
    middle = [float(sum(v[axis] for v in world.mesh.vertices) * world.mesh.scale[axis] / len(world.mesh.vertices)) for axis in (0, 1)]
    ends = [(middle[0] - 8, middle[1] - 3), (middle[0] + 5, middle[1] + 6)]
    for at in ends:
        b.touch("Start", places_of(b, [at])[0])
        b.touch("End")
    top = b.value("document.getElementById('chart').getBoundingClientRect().top")
    expect(all(y < top for _, y in places_of(b, ends)), "the chart lies over the profile")
    keep("telephone-chart")
    expect(b.value("acut.profile().length") > 2, "no profile by touch")
    the_bar_shows(b, "acut.page.tools.corners.profile.at(-1)")
    expect(b.value(OUTSIDE) == [], b.value(OUTSIDE))
    b.size(860, 600)


def what_cannot_be_shown_is_said():
    b = world.browser
    text = "document.getElementById('message').innerText"
    b.open(world.fetch("empty.html", "--max-edge", "0.001"))
    expect(not b.ready() and "no triangles" in b.value(text), b.value(text))
    scheme = "getComputedStyle(document.documentElement).colorScheme"
    before = b.value(scheme)
    b.value("document.getElementById('theme').click(), document.getElementById('about-open').click(), document.getElementById('about-close').click()")
    expect(b.value(scheme) != before and not b.value("document.getElementById('about').open"), "buttons of a page without triangles do nothing")
    for script, word in (("HTMLCanvasElement.prototype.getContext = () => null", "WebGL 2"), ("delete window.DecompressionStream", "DecompressionStream"),
                         ("window.DecompressionStream = class { constructor(f) { if (f !== 'gzip') throw new TypeError(f); } }", "deflate-raw")):
        id = b.call("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
        b.open(world.page)
        expect(not b.ready() and word in b.value(text), b.value(text))
        b.call("Page.removeScriptToEvaluateOnNewDocument", identifier=id)
    expect(b.said == [], b.said)
    with open(world.page) as f:
        whole = f.read()
    lines = whole.split('id="faces">')
    with open(world.path("damaged.html"), "w") as f:
        f.write(lines[0] + 'id="faces">' + lines[1].replace("A", "B", 40))
    b.open(world.path("damaged.html"))
    expect(not b.ready() and "cannot be read" in b.value(text), b.value(text))
    b.said.clear()


def the_policy_forbids_requests():
    b = world.show(world.page)
    expect(all(r.startswith("file://" + world.base) for r in b.requests), b.requests)
    expect(b.value("fetch('http://127.0.0.1:9/').then(() => 'came', e => String(e))").startswith("TypeError"), "a request goes out")
    until(lambda: b.value("1") and any("Content Security Policy" in s for s in b.said), "nothing forbids it: %s" % b.said)


def main():
    global world
    if not shutil.which("chromium"):
        e2e.unavailable("chromium is not installed (chromium)")
    with Folder() as base:
        world = World(base)
        try:
            e2e.main(the_page_is_ready_and_asks_for_nothing, heights_are_those_of_the_mesh, heights_in_feet_and_from_an_origin,
                     degrees_from_an_origin_are_as_long_as_before, shapes_that_are_unlike_a_survey, a_profile_by_clicks_is_the_section,
                     a_distance_by_clicks, each_display_is_another_picture, each_domain_has_a_colour, contours_are_at_true_heights,
                     keys_act_after_a_control_was_used, a_window_that_changes_shows_the_whole_mesh, light_and_dark, no_card_lies_over_another,
                     a_telephone, what_cannot_be_shown_is_said, the_policy_forbids_requests)
        finally:
            world.done()


main()
