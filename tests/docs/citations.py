#!/usr/bin/env python3
"""What comments cite must exist: sections of algorithm.md by number, headings of other pages by name, source files, and names with an
underscore, which some code or build file must have. The same for files and names that pages cite as code."""
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SOURCE = (".c", ".h", ".cpp", ".def")
COMMENT = re.compile(r'"(?:\\.|[^"\\\n])*"|(/\*.*?\*/)', re.S)
SECTION = re.compile(r"algorithm\.md (\d+(?:(?:, | to | and )\d+)*)")
HEADING = re.compile(r'\b([\w-]+\.md), "([^"]+)"')
# Headers of the C library, files of the kernel.
FOREIGN = {"sched.h", "linux/magic.h", "drivers/usb/core/devio.c"}
FILE = re.compile(r"(?<![\w.%*-])((?:[a-z][a-z0-9_-]*/)*[a-z][a-z0-9_]*\.(?:c|h|cpp|def))\b")
NAME = re.compile(r"(?<![\w/.%-])([a-z]\w*_\w+)\b(?!\.(?:c|h|cpp|def|py)|\*)")
# Placeholders, and names of the kernel, of formulas, of columns.
PLACEHOLDER = re.compile(r"NAME|FIELD|_X(?:_|$)")
FOREIGN_NAMES = {"protected_symlinks", "proc_do_submiturb", "usbfs_increase_memory_usage", "z_a", "default_text"}
PAGES = re.compile(r"^(?:docs/design/\w+|ARCHITECTURE|HACKING)\.md$")
CODE = re.compile(r"```.*?```|`([^`\n]+)`", re.S)


def tracked():
    """The files of the source, by their paths from the root. An archive of it has no .git, and git may be missing."""
    try:
        run = subprocess.run(["git", "ls-files"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
        found = run.stdout.decode().split()
    except FileNotFoundError:
        found = []
    for folder, names, files in os.walk(ROOT) if not found else ():
        names[:] = [n for n in names if not n.startswith((".", "build", "obj-", "fuzz-corpus")) or n == "build-aux"]
        found += (os.path.relpath(os.path.join(folder, f), ROOT) for f in files)
    return found


def headings(path):
    """With their number, if they have one, and without it."""
    with open(os.path.join(ROOT, path), encoding="utf-8") as f:
        heads = re.findall(r"^#+ (.+)$", f.read(), re.M)
    return set(heads) | {re.sub(r"^\d+\. ", "", h) for h in heads}


def read(file):
    with open(os.path.join(ROOT, file), encoding="utf-8", errors="replace") as f:
        return f.read()


def names_of_code(files):
    """All words of code and build files, without those of C comments."""
    words = set()
    for file in files:
        if file.endswith(SOURCE):
            words |= set(re.findall(r"[A-Za-z_]\w*", COMMENT.sub(lambda m: "" if m[1] else m[0], read(file))))
        elif file.endswith((".py", ".proto", "meson.build", "meson_options.txt")) or "/" not in file:
            words |= set(re.findall(r"[A-Za-z_]\w*", read(file)) if not file.endswith(".md") else ())
    return words


def missing_file(name, files, bases):
    if name in FOREIGN:
        return False
    return not any(f == name or f.endswith("/" + name) for f in files) if "/" in name else name not in bases


def pages_wrong(files, bases, code):
    wrong, cited = [], 0
    for file in filter(PAGES.match, files):
        text = read(file)
        for m in CODE.finditer(text):
            line = f"{file}:{text.count(chr(10), 0, m.start()) + 1}"
            for name in FILE.findall(m[1] or ""):
                cited += 1
                if not PLACEHOLDER.search(name) and missing_file(name, files, bases):
                    wrong.append(f"{line}: there is no file {name}")
            for name in NAME.findall(m[1] or ""):
                cited += 1
                if not PLACEHOLDER.search(name) and name not in code | FOREIGN_NAMES:
                    wrong.append(f"{line}: nothing is named {name}")
        for listed in re.findall(r"\(([a-z0-9_]+\.[ch](?:, [a-z0-9_]+\.[ch])*)\)", text):
            wrong += [f"{file}: there is no file {name}" for name in listed.split(", ") if name not in bases]
    return wrong, cited


def main():
    files = tracked()
    names = {os.path.basename(f) for f in files} | FOREIGN
    pages = {os.path.basename(f): headings(f) for f in files if f.endswith(".md")}
    sections = {h.split(".")[0] for h in pages["algorithm.md"]}
    wrong, cited, code = [], 0, names_of_code(files)
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
            wrong += [f"{line}: there is no file {name}" for name in sorted(sources) if missing_file(name, files, names)]
            cites = {n for n in NAME.findall(comment) if not PLACEHOLDER.search(n)} - FOREIGN_NAMES
            wrong += [f"{line}: nothing is named {name}" for name in sorted(cites - code)]
            cited += len(numbers) + len(quoted) + len(sources)
    more, paged = pages_wrong(files, names, code)
    wrong += more
    if paged < 200:
        wrong.append(f"only {paged} citations found in pages: they cannot be read")
    if cited < 500:
        wrong.append(f"only {cited} citations found: the comments cannot be read")
    print("\n".join(wrong) or f"{cited} citations")
    return 1 if wrong else 0


sys.exit(main())
