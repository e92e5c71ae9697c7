"""The table of input formats (base/input_format.def) against the lists elsewhere: acutctl's own, the manual, README and guide."""
import json
import os
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from tables import compare, find, read, wrong

ACUTCTL = os.environ["ACUTCTL"]
PACKED = {"gz", "zip"}  # acutctl unpacks these itself


def table():
    """Name, title, extensions, those of folders, help."""
    rows = [[name] + re.findall(r'"([^"]*)"', rest) for name, rest in re.findall(r"^INPUT_FORMAT\((\w+),(.*?)\)$", read("base/input_format.def"), re.M | re.S)]
    if len(rows) < 4 or any(len(r) != 5 for r in rows):
        sys.exit("the table cannot be read: %s" % rows)
    return rows


rows = table()
names = [r[0] for r in rows]
extensions = [e for r in rows for e in r[2].split()]

listed = [json.loads(line) for line in subprocess.run([ACUTCTL, "formats", "--json"], stdout=subprocess.PIPE, check=True).stdout.splitlines()]
compare("acutctl formats", [[j["format"], j["help"], j["extensions"]] for j in listed if j["direction"] == "in" and j["format"] not in PACKED],
        [[r[0], r[4], r[2]] for r in rows])

page = read("man/acutctl.1.scd")
option = find("--input-format", r"\*--input-format\* _FORMAT_\n\t(.*?)\n\n", page)
compare("acutctl(1), --input-format", sorted(re.findall(r"\*(\w+)\*", option)), sorted(set(names) | {e[1:] for e in extensions}))
compare("acutctl-json(7), format", re.findall(r"\*(\w+)\*", find("format of a file", r"\*file\*, \*format\* \(_text_\)\n\tIts name; ([^\n]*)",
                                                                read("man/acutctl-json.7.scd"))), names)

# What a folder is searched for, as acutctl says it of an empty one.
with tempfile.TemporaryDirectory() as folder:
    said = subprocess.run([ACUTCTL, "mesh", folder, "-o", os.path.join(folder, "o.ply")], stdout=subprocess.PIPE, stderr=subprocess.PIPE).stderr.decode()
folders = sorted(e for r in rows for e in r[3].split())
compare("what a folder is searched for", sorted(set(re.findall(r"\.[a-z]+\b", find("the hint", r"files ending in ([^\n]*)", said))) - {".zip", ".gz"}), folders)
compare("acutctl(1), folders", sorted(re.findall(r"\.[a-z]+\b", find("folders", r"the files ending in ([^)]*?), packed", page))), folders)

for name, pattern in (("README.md", r"\nInputs: (.*?)\. Outputs:"), ("docs/guide.md", r"\nInputs: (.*?)\n\n")):
    text = find("the inputs of " + name, pattern, read(name))
    for word in re.findall(r"[A-Z]{3,}", " ".join(r[1] for r in rows)):
        if word not in text:
            wrong.append("%s: %s is not among the inputs" % (name, word))

print("\n".join(wrong) or "%d formats, %d extensions" % (len(rows), len(extensions)))
sys.exit(1 if wrong else 0)
