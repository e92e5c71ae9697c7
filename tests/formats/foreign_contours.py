"""Contours, read by other programs: foreign_contours.py gdal|qgis. GDAL reads back each line of all three formats, and its lengths by level are
those of the triangles of the PLY of the same mesh. QGIS makes contours of that PLY itself: off the levels of the lattice they have
the same lengths (on them it loses some: fractions are the judge there)."""
import csv
import io
import json
import math
import os
import re
import shutil
import sqlite3
import subprocess
import sys
from collections import defaultdict
from fractions import Fraction

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from contours import by_triangles, length_of, near, read_ply, survey  # noqa: E402
from e2e import Daemon, Folder, expect  # noqa: E402

POINTS = 20000


def gdal_lines(path):
    """[(attributes, points)], as GDAL reads them."""
    text = e2e.run(["ogr2ogr", "-f", "CSV", "/vsistdout/", "-lco", "GEOMETRY=AS_WKT", path]).ok().out
    csv.field_size_limit(1 << 30)
    lines = []
    for row in csv.DictReader(io.StringIO(text)):
        kind, points = re.fullmatch(r"LINESTRING( Z)? \((.*)\)", row.pop("WKT")).groups()
        expect(kind == " Z", "a line without heights in " + path)
        lines.append((row, [tuple(float(n) for n in p.split()) for p in points.split(",")]))
    return lines


def gdal_reads_lines():
    with Folder() as base, Daemon(base) as d:
        las = survey(base, POINTS)
        path = {k: os.path.join(base, "m." + k) for k in ("ply", "gpkg", "geojson", "dxf")}
        for words, step in (("1m", Fraction(100)), ("1.005", Fraction(1005, 10))):
            d.ctl("mesh", las, "-o", path["ply"], *[w for k in ("gpkg", "geojson", "dxf") for w in ("-o", path[k], "--interval", words)]).ok()
            want = by_triangles(*read_ply(path["ply"]), step)
            counts = set()
            for kind in ("gpkg", "geojson", "dxf"):
                found, lines = defaultdict(float), gdal_lines(path[kind])
                for row, points in lines:
                    heights = {p[2] for p in points}
                    expect(len(heights) == 1, "heights of a line: %s" % heights)
                    level = round(Fraction(heights.pop()).limit_denominator(10 ** 6) * 100 / step)
                    if kind == "dxf":
                        name = ("%.3f" % float(level * step / 100)).rstrip("0").rstrip(".").replace(".", "_")
                        expect(row["Layer"] == ("CONTOUR_" if level % 5 else "INDEX_") + name, "%s is not %s" % (row["Layer"], name))
                    else:
                        expect(int(row["index"]) == (level % 5 == 0), str(row))
                        expect(int(row["closed"]) == (points[0] == points[-1]), str(row))
                        expect(near(float(row["length"]), length_of(points)), str(row))
                    found[level] += length_of(points)
                counts.add(len(lines))
                expect(set(found) == {n for n, v in want.items() if v > 0}, "%s: levels" % kind)
                for level, length in want.items():
                    expect(near(found[level], length), "%s: level %d: %.9f, not %.9f" % (kind, level, found[level], length))
            expect(len(counts) == 1 and counts.pop() > 1000, "numbers of lines: %s" % counts)
        # Edited: the triggers keep the index.
        for what in ("DELETE FROM contours WHERE fid % 3 = 1", "UPDATE contours SET geom = (SELECT geom FROM contours WHERE fid = 2) WHERE fid = 3",
                     "INSERT INTO contours (elevation, \"index\", closed, length, geom) SELECT elevation, \"index\", closed, length, geom FROM contours"):
            e2e.run(["ogrinfo", path["gpkg"], "-sql", what]).ok()
        with sqlite3.connect(path["gpkg"]) as f:
            n = f.execute("SELECT count(*) FROM contours").fetchone()
            expect(f.execute("SELECT count(*) FROM rtree_contours_geom").fetchone() == n and n[0] > 1000, "%s lines" % n)
            expect(f.execute("SELECT rtreecheck('rtree_contours_geom')").fetchone() == ("ok",), "the index has faults")
        d.ctl("mesh", las, "-o", path["gpkg"], "--interval", "1").ok()
        for kind in ("gpkg", "geojson"):
            said = e2e.run(["ogrinfo", "-so", "-al", path[kind]]).ok().out
            expect("Geometry: 3D Line String" in said and 'ID["EPSG",32633]' in said, said)
            expect("ERROR" not in said and "Warning" not in said, said)
        # A plane without a system is not degrees.
        plain = os.path.join(base, "plain.xyz")
        with open(plain, "w") as f:
            f.writelines("%d %d %d\n" % (500000 + i % 5, 5000000 + i // 5, i) for i in range(25))
        d.ctl("mesh", plain, "-o", path["geojson"], "--interval", "1").ok()
        said = e2e.run(["ogrinfo", "-so", "-al", path["geojson"]]).ok().out
        expect('ENGCRS["unknown"' in said and "WGS" not in said, said)


# ---- QGIS ----

JUDGE = """
import json, sys
from qgis.core import *
from qgis.analysis import QgsNativeAlgorithms
QgsApplication.setPrefixPath('/usr', True)
app = QgsApplication([], False)
app.initQgis()
registry = QgsApplication.processingRegistry()
registry.addProvider(QgsNativeAlgorithms())
ply, out, levels = sys.argv[1], sys.argv[2], sys.argv[3]
mesh = QgsMeshLayer(ply, 'm', 'mdal')
mesh.setCrs(QgsCoordinateReferenceSystem('EPSG:32633'))
project = QgsProject.instance()
project.addMapLayer(mesh)
context = QgsProcessingContext()
context.setProject(project)
registry.algorithmById('native:meshcontours').run(dict(INPUT=mesh.id(), DATASET_GROUPS=[0], DATASET_TIME={'type': 'static'}, CONTOUR_LEVEL_LIST=levels,
    OUTPUT_LINES=out, OUTPUT_POLYGONS='TEMPORARY_OUTPUT'), context, QgsProcessingFeedback())
sums = {}
for f in QgsVectorLayer(out, 'l', 'ogr').getFeatures():
    level = '%.6f' % next(f[n] for n in f.fields().names() if n not in ('fid', 'group', 'time'))
    sums[level] = sums.get(level, 0) + f.geometry().length()
print('SUMS ' + json.dumps(sums))
# Ours is a layer of QGIS.
ours = QgsVectorLayer(sys.argv[4], 'ours', 'ogr')
assert ours.isValid() and ours.crs().authid() == 'EPSG:32633' and ours.featureCount() > 100, (ours.isValid(), ours.crs().authid())
sums = {}
for f in ours.getFeatures():
    level = '%.6f' % f['elevation']
    sums[level] = sums.get(level, 0) + f.geometry().length()
print('OURS ' + json.dumps(sums))
"""


def qgis_has_the_same_lengths():
    with Folder() as base, Daemon(base) as d:
        las, ply, gpkg = survey(base, POINTS), os.path.join(base, "m.ply"), os.path.join(base, "m.gpkg")
        d.ctl("mesh", las, "-o", ply, "-o", gpkg, "--interval", "4", "--base", "0.005").ok()
        heights = [v[2] / 100 for v in read_ply(ply)[0]]
        low, high = min(heights), max(heights)
        levels = [n * 4 + 0.005 for n in range(math.ceil(low / 4), math.floor(high / 4) + 1)]
        env = {"QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": base, "HOME": base}
        out = e2e.run(["/usr/bin/python3", "-c", JUDGE, ply, os.path.join(base, "q.gpkg"), ",".join("%.3f" % v for v in levels), gpkg], env=env).ok().out
        theirs, ours = (json.loads(re.search(r"%s (.*)" % word, out)[1]) for word in ("SUMS", "OURS"))
        expect(len(ours) > 8 and set(ours) == set(theirs), "levels: %s" % (set(ours) ^ set(theirs)))
        worst = max(abs(ours[k] - theirs[k]) / ours[k] for k in ours)
        print("     %d levels, %.0f m, %.1e apart" % (len(ours), sum(ours.values()), worst))
        expect(worst < 1e-6, "lengths are %.2e apart" % worst)


def main():
    if sys.argv[1] == "gdal":
        if not shutil.which("ogr2ogr"):
            e2e.unavailable("ogr2ogr is not installed (gdal-bin)")
        e2e.main(gdal_reads_lines)
    # 750 MB of packages: it is tested where it is.
    if subprocess.run(["/usr/bin/python3", "-c", "import qgis.analysis"], stderr=subprocess.DEVNULL, check=False).returncode:
        e2e.skip("QGIS is not installed (python3-qgis, qgis-providers)")
    e2e.main(qgis_has_the_same_lengths)


main()
