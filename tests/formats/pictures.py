"""The pictures of the README, of a generated survey, by headless Chromium. pictures.py BUILD makes them with the programs of a build
folder; without it they are made again and compared with those in docs/pictures, so a picture that is not of this version fails."""
import base64
import os
import shutil
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
if len(sys.argv) > 1:
    for name, program in (("ACUTD", "daemon/acutd"), ("ACUTCTL", "client/acutctl/acutctl"), ("ACUT_SYNTH", "tools/acut-synth")):
        os.environ[name] = os.path.join(sys.argv[1], program)
sys.path.insert(0, os.path.join(HERE, "..", "e2e"))
import e2e  # noqa: E402
from chromium import Browser  # noqa: E402
from e2e import Daemon, Folder, expect  # noqa: E402

FOLDER = os.path.join(HERE, "..", "..", "docs", "pictures")
LARGEST = 300000
# Of 255 levels, on average over all pixels and colours. Another version of the browser or other fonts stay far below, another
# display or another mesh far above.
DIFFERENCE = 4
COMPARE = """(async names => {
    const data = [];
    for (const name of names) {
        const picture = await createImageBitmap(await (await fetch("data:image/png;base64," + name)).blob());
        const canvas = new OffscreenCanvas(picture.width, picture.height), context = canvas.getContext("2d");
        context.drawImage(picture, 0, 0);
        data.push([picture.width, picture.height, context.getImageData(0, 0, picture.width, picture.height).data]);
    }
    const [a, b] = data;
    if (a[0] !== b[0] || a[1] !== b[1])
        return 255;
    return a[2].reduce((sum, n, i) => sum + Math.abs(n - b[2][i]), 0) / (a[0] * a[1] * 3);
})(%s)"""

ALONE = """for (const card of document.querySelectorAll(".card")) card.style.visibility = "hidden";"""


def choose(b, mode, *checks):
    b.value("[...document.querySelectorAll('#modes *')].find(e => e.textContent.trim() === '%s').click()" % mode)
    for check in checks:
        b.value("document.getElementById('%s').click()" % check)


def zoom(b, factor, east, north):
    """Closer to a part of the extent."""
    b.value("""(() => {const {page} = acut, {camera, surface} = page, at = [%g, %g].map((part, i) => surface.low[i] + part * (surface.high[i] - surface.low[i]));
        camera.zoom(%g, [...at, surface.height(at[0], at[1])]); camera.target = [...at, surface.height(at[0], at[1])]; page.draw();})()""" % (east, north, factor))


def terrain(b):
    choose(b, "Elevation")
    b.value(ALONE)
    zoom(b, 0.62, 0.5, 0.45)


def triangles(b):
    choose(b, "Domains", "wire")
    b.value(ALONE)
    zoom(b, 0.028, 0.33, 0.33)


def contours(b):
    choose(b, "Hillshade", "contours")
    b.value("document.getElementById('top').click()")
    b.value(ALONE)
    zoom(b, 0.35, 0.5, 0.5)


def page(b):
    choose(b, "Elevation", "contours", "profile")
    for x, y in ((400, 300), (520, 260), (700, 330)):
        b.click(x, y)
    b.mouse("Moved", 480, 540)


def shown(b, path, name, draw, size):
    """The bytes of a picture. The page opens in its size: it hears of another one with its next frame, maybe after clicks."""
    b.size(*size)
    b.open("/dev/null")
    b.open(path)
    expect(b.ready(), b.said)
    draw(b)
    b.value("acut.page.draw(), new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    made = os.path.join(os.path.dirname(path), name)
    b.picture(made)
    with open(made, "rb") as f:
        return f.read()


def each(compare):
    if not shutil.which("chromium"):
        e2e.unavailable("chromium is not installed")
    with Folder() as base, Daemon(base, memory="24M") as d, Browser(base) as b:
        survey, html = os.path.join(base, "survey.las"), os.path.join(base, "survey.html")
        e2e.run([e2e.SYNTH, "--points", "250000", "--density", "1", survey]).ok()
        d.ctl("push", "survey", survey).ok()
        d.ctl("submit", "survey", "--ground", "--wait").ok()
        d.ctl("fetch", "1", "--trim-hull", "40m", "-o", html).ok()
        for draw, *size in ((terrain, 800, 450), (triangles, 800, 450), (contours, 640, 360), (page, 960, 660)):
            name = draw.__name__ + ".png"
            compare(b, name, shown(b, html, name, draw, size))


def write(b, name, data):
    expect(len(data) < LARGEST, "%s has %d bytes" % (name, len(data)))
    os.makedirs(FOLDER, exist_ok=True)
    with open(os.path.join(FOLDER, name), "wb") as f:
        f.write(data)
    print("%s: %d bytes" % (name, len(data)))


def same(b, name, data):
    with open(os.path.join(FOLDER, name), "rb") as f:
        kept = f.read()
    expect(len(kept) < LARGEST, "%s has %d bytes" % (name, len(kept)))
    b.open("/dev/null")
    difference = b.value(COMPARE % [base64.b64encode(d).decode() for d in (kept, data)])
    print("     %-16s differs by %.2f levels" % (name, difference))
    expect(difference < DIFFERENCE, "docs/pictures/%s is stale: it differs by %.1f levels; if it shall be like this now: tests/formats/pictures.py build" % (name, difference))


def pictures_are_of_this_version():
    each(same)


if len(sys.argv) > 1:
    each(write)
else:
    e2e.main(pictures_are_of_this_version)
