"""epsg_table.py TEST-EPSG EPSG-TABLE PROJ.DB: the table that acut was built with says of every number what PROJ's database
says, asked in another way than the table was made; the same database gives the same table; what is none gives none."""
import os
import sqlite3
import subprocess
import sys
import tempfile

dump, maker, path = sys.argv[1:]
db = sqlite3.connect("file:%s?mode=ro" % path, uri=True)


def unit(system, order):
    """By its size, not by its number."""
    row = db.execute("SELECT u.type, u.conv_factor FROM axis a JOIN unit_of_measure u ON u.auth_name = a.uom_auth_name AND "
                     "u.code = a.uom_code WHERE a.coordinate_system_auth_name = 'EPSG' AND a.coordinate_system_code = ? AND "
                     "a.coordinate_system_order = ?", (system, order)).fetchone()
    if not row or row[1] is None:
        return "unknown"
    if row[0] == "angle":
        return "degree" if abs(row[1] - 0.017453292519943295) < 1e-12 else "unknown"
    near = [n for n, size in (("metre", 1), ("foot", 0.3048), ("us-survey-foot", 1200 / 3937)) if abs(row[1] - size) < 1e-12]
    return near[0] if near else "unknown"


def wanted():
    lines = {}
    kinds = dict(db.execute("SELECT code, type FROM crs_view WHERE auth_name = 'EPSG'"))
    for table in ("projected_crs", "geodetic_crs", "vertical_crs"):
        for code, name, system in db.execute("SELECT code, name, coordinate_system_code FROM %s WHERE auth_name = 'EPSG'" % table):
            kind = kinds[code]
            if kind == "vertical":
                lines[code] = (name, "vertical", unit(system, 1))
            else:
                plane = {"projected": "1", "geographic 2D": "2", "geographic 3D": "2", "geocentric": "3"}[kind]
                assert unit(system, 1) == unit(system, 2), code
                lines[code] = (name, plane, unit(system, 1), unit(system, 3))
    for code, name, plane, heights in db.execute("SELECT code, name, horiz_crs_code, vertical_crs_code FROM compound_crs "
                                                 "WHERE auth_name = 'EPSG'"):
        lines[code] = (name, "compound", str(plane), str(heights))
    return lines


def main():
    got = {}
    for line in subprocess.run([dump, "--dump"], stdout=subprocess.PIPE, check=True).stdout.decode().splitlines():
        words = line.split("\t")
        got[int(words[0])] = tuple(words[1:])
    want = wanted()
    assert len(want) > 6000, len(want)
    for code in sorted(set(got) | set(want)):
        if got.get(code) != want.get(code):
            sys.exit("EPSG:%d is %s, PROJ has %s" % (code, got.get(code), want.get(code)))
    with tempfile.TemporaryDirectory() as base:
        texts = []
        for name in ("a.c", "b.c"):
            subprocess.run([maker, path, os.path.join(base, name)], check=True)
            with open(os.path.join(base, name), "rb") as f:
                texts.append(f.read())
        assert texts[0] == texts[1], "two tables of one database differ"
        for bad in (dump, os.path.join(base, "none.db")):
            r = subprocess.run([maker, bad, os.path.join(base, "c.c")], stderr=subprocess.PIPE)
            assert r.returncode and b"is not PROJ's database" in r.stderr, (bad, r.stderr)
    print("%d numbers" % len(want))


main()
