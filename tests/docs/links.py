#!/usr/bin/env python3
"""Documents: every link to a file of the tree, and to a heading in it, leads somewhere; README and ARCHITECTURE stay short
enough to be read."""
import os
import re
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
LINK = re.compile(r"\]\(([^)#\s]*)(#[^)\s]*)?\)")
MOST_LINES = {"README.md": 150, "ARCHITECTURE.md": 130}


def documents():
    for folder, names, files in os.walk(ROOT):
        names[:] = [n for n in names if not n.startswith((".", "build"))]
        yield from (os.path.join(folder, f) for f in files if f.endswith(".md"))


def anchors(text):
    """Of the headings, as they are named on the web."""
    heads = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in heads}


def main():
    wrong, links = [], 0
    for path in documents():
        with open(path, encoding="utf-8") as f:
            text = f.read()
        name = os.path.relpath(path, ROOT)
        for to, heading in LINK.findall(text):
            if re.match(r"[a-z]+:", to):
                continue
            links += 1
            target = os.path.normpath(os.path.join(os.path.dirname(path), to)) if to else path
            if not os.path.exists(target):
                wrong.append(f"{name}: {to} is not there")
            elif heading:
                with open(target, encoding="utf-8") as f:
                    if heading[1:] not in anchors(f.read()):
                        wrong.append(f"{name}: {to}{heading}: there is no such heading")
        if text.count("\n") > MOST_LINES.get(name, 10000):
            wrong.append(f"{name}: {text.count(chr(10))} lines, more than {MOST_LINES[name]}")
    if links < 10:
        wrong.append(f"{links} links found: they cannot be read")
    print("\n".join(wrong) or f"{links} links")
    return 1 if wrong else 0


sys.exit(main())
