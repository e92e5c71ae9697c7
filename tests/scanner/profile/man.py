#!/usr/bin/env python3
"""acut-scanners.d(5): every key and every word of a key is in it, in its section; its example is a profile.

man.py ACUT_SCAN SOURCE_ROOT
"""
import re, subprocess, sys, tempfile

SCAN, ROOT = sys.argv[1:3]
page = open(ROOT + "/man/acut-scanners.d.5.scd").read()
rows = re.findall(r'^\t\{"(\w*)", "([\w-]+)", (PROFILE_\w+).*?(?:, "([^"]*)")?\},$', open(ROOT + "/scanner/profile/profile_table.c").read(), re.M)
assert len(rows) > 50, len(rows)
parts = dict(re.findall(r"^# (.*?)\n(.*?)(?=^# |\Z)", page, re.M | re.S))
names = {"": "BEFORE THE SECTIONS", "start": "[start], [stop]", "stop": "[start], [stop]"}
bad = []
for section, key, kind, words in rows:
    text = parts[names.get(section, "[%s]" % section)]
    if not re.search(r"\*%s\* = " % re.escape(key), text):
        bad.append("[%s] %s" % (section, key))
    for word in words.split("|") if words else []:
        if "*%s*" % word not in text:
            bad.append("[%s] %s = %s" % (section, key, word))
for key in re.findall(r"^\*([\w-]+)\* = |, \*([\w-]+)\* = ", page, re.M):
    if (key[0] or key[1]) not in [r[1] for r in rows]:
        bad.append("no such key: %s" % (key,))
for name in re.findall(r'^\t\{"([\w-]+)", ', open(ROOT + "/scanner/decoder/decoder.c").read(), re.M):
    if "*%s*" % name not in parts["[decoder]"]:
        bad.append("decoder " + name)
assert not bad, "acut-scanners.d(5) and the program differ: " + "; ".join(bad)
example = re.search(r"```\n(.*?)```", parts["EXAMPLE"], re.S).group(1).replace("\\\\", "\\")
with tempfile.TemporaryDirectory() as d:
    open(d + "/example.conf", "w").write(example)
    r = subprocess.run([SCAN, "profiles", d + "/example.conf"], capture_output=True, text=True)
    assert r.returncode == 0 and "good" in r.stdout, r.stderr
print(len(rows), "keys")
