"""The table of output formats (client/format/format_table.c) against the lists elsewhere: acutctl's own, the manuals, README, guide, the
picture of ARCHITECTURE, and the test of --resume."""
import json
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
from tables import SOURCE, compare, find, read, wrong

ACUTCTL = os.environ["ACUTCTL"]


def shared(text):
    """The members that the row takes from a macro of a header beside it."""
    if "FORMAT_LINES_ROW" not in text:
        return {}
    macro = find("FORMAT_LINES_ROW", r"#define FORMAT_LINES_ROW\s((?:.*\\\n)*.*)", read("client/format/format_lines.h"))
    return dict(re.findall(r"\.(\w+) = (\w+)", macro))


def row(name):
    """The members of a row that have one word or text, by name."""
    folder = os.path.join(SOURCE, "client")
    for place, _, files in os.walk(folder):
        for file in files:
            found = re.search(r"^const struct format format_%s = \{(.*?)^\};" % name, read(os.path.join(place, file)), re.M | re.S)
            if found:
                return {**shared(found.group(1)), **dict(re.findall(r'\.(\w+) = "?(.*?)"?,$', found.group(1), re.M))}
    sys.exit("format_%s is nowhere below client" % name)


names = re.findall(r"&format_(\w+)", find("the table", r"\brow\[\] = \{(.*?)\}", read("client/format/format_table.c")))
rows = {n: row(n) for n in names}
if len(rows) < 2 or any(not {"name", "extensions", "help", "purpose", "kind"} <= set(r) for r in rows.values()):
    sys.exit("the table cannot be read: %s" % rows)
names = [rows[n]["name"] for n in names]
rows = {r["name"]: r for r in rows.values()}
WORD = r"\b(?:Land|Geo(?=JSON))?[A-Z]{3,}\b"  # the name of a format
written = [n for n in names if rows[n]["kind"] != "FORMAT_NOTHING"]
lines = [n.split("-")[0] for n in names if rows[n]["kind"] == "FORMAT_LINES"]
surfaces = [n for n in written if rows[n]["kind"] != "FORMAT_LINES"]
meshes = [n for n in names if rows[n]["kind"] == "FORMAT_MESH"]
resumable = [n for n in names if "resume" in rows[n]]

listed = [json.loads(line) for line in subprocess.run([ACUTCTL, "formats", "--json"], stdout=subprocess.PIPE, check=True).stdout.splitlines()]
compare("acutctl formats", [j["format"] for j in listed if j["direction"] == "out"], names)
compare("acutctl formats, extensions", [j["extensions"] for j in listed if j["direction"] == "out"], [rows[n]["extensions"] for n in names])

page = read("man/acutctl.1.scd")
option = find("--format", r"\n\*--format\* _FORMAT_\n\t(.*?)\n\n", page)
what, nothing = option.split("does not say it.", 1)
compare("acutctl(1), --format", re.findall(r"\*([\w-]+)\*", what), written)
compare("acutctl(1), --format, that write nothing", re.findall(r"\*(\w+)\*", nothing), [n for n in names if n not in written])
compare("acutctl(1), --resume", re.findall(r"\*([\w-]+)\*", find("--resume", r"is replaced\.\s+([^.]*?) files can be resumed", page)), resumable)
layout = find("what files have", r"\n(PLY is binary.*?)\n# ", page)
compare("acutctl(1), what files have", [n for n in written if re.search(r"\b%s( \(1\.2\))?\s+(is|holds)\b" % n, layout, re.I)], written)
compare("acut(7), mesh", [w.lower() for w in re.findall(WORD, find("mesh", r"It is fetched as (.*?) or tiles", read("man/acut.7.scd")))], meshes)
for name, pattern, of_lines in (("README.md", r"\. Outputs: (.*?),\ncontours", r"\ncontours as (.*?)\."),
                                ("docs/guide.md", r"\. Outputs: (.*?); contours", r"; contours as (.*?)\."),
                                ("ARCHITECTURE.md", r"meshes: ([A-Za-z, ]*)", r"contours: ([A-Za-z, ]*)")):
    for what, where, wanted in (("outputs", pattern, surfaces), ("contours", of_lines, lines)):
        text = find("the %s of %s" % (what, name), where, read(name))
        compare("%s, %s" % (name, what), [w.lower() for w in re.findall(WORD, text)], wanted)

compare("tests/e2e/refetch.py", re.findall(r'"([\w-]+)"', find("RESUMABLE", r"\nRESUMABLE = \((.*?)\)", read("tests/e2e/refetch.py"))), resumable)

print("\n".join(wrong) or "%d formats" % len(rows))
sys.exit(1 if wrong else 0)
