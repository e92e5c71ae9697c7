#!/usr/bin/env python3
"""What comments cite must exist: sections of algorithm.md by number, headings of other pages by name, and source files of the
project by their base names."""
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SOURCE = (".c", ".h", ".cpp", ".def")
COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|(/\*.*?\*/)', re.S)
SECTION = re.compile(r"algorithm\.md (\d+(?:(?:, | to | and )\d+)*)")
HEADING = re.compile(r'\b([\w-]+\.md), "([^"]+)"')
# Headers of the C library.
FOREIGN = {"sched.h"}
FILE = re.compile(r"(?<![\w/.%-])([a-z][a-z0-9_]*\.(?:c|h|cpp|def))\b")


def tracked():
    out = subprocess.run(["git", "ls-files"], cwd=ROOT, stdout=subprocess.PIPE, check=False).stdout.decode().split()
    if out:
        return out
    return [os.path.relpath(os.path.join(folder, f), ROOT) for folder, _, files in os.walk(ROOT) for f in files]


def headings(path):
    """With their number, if they have one, and without it."""
    with open(os.path.join(ROOT, path), encoding="utf-8") as f:
        heads = re.findall(r"^#+ (.+)$", f.read(), re.M)
    return set(heads) | {re.sub(r"^\d+\. ", "", h) for h in heads}


def main():
    files = tracked()
    names = {os.path.basename(f) for f in files} | FOREIGN
    pages = {os.path.basename(f): headings(f) for f in files if f.endswith(".md")}
    sections = {h.split(".")[0] for h in pages["algorithm.md"]}
    wrong, cited = [], 0
    for file in files:
        if not file.endswith(SOURCE):
            continue
        with open(os.path.join(ROOT, file), encoding="utf-8") as f:
            text = f.read()
        for m in COMMENT.finditer(text):
            comment = re.sub(r"\s*\n\s*\*?\s*", " ", m[1] or "")
            line = f"{file}:{text.count(chr(10), 0, m.start()) + 1}"
            numbers = [n for s in SECTION.findall(comment) for n in re.findall(r"\d+", s)]
            wrong += [f"{line}: algorithm.md has no section {n}" for n in numbers if n not in sections]
            quoted = HEADING.findall(comment)
            wrong += [f"{line}: {page} has no heading \"{title}\"" for page, title in quoted if title not in pages.get(page, [])]
            sources = set(FILE.findall(comment))
            wrong += [f"{line}: there is no file {name}" for name in sorted(sources - names)]
            cited += len(numbers) + len(quoted) + len(sources)
    if cited < 500:
        wrong.append(f"only {cited} citations found: the comments cannot be read")
    print("\n".join(wrong) or f"{cited} citations")
    return 1 if wrong else 0


sys.exit(main())
