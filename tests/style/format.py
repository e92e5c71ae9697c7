#!/usr/bin/env python3
"""The code is as .clang-format says, by the version that it is written for."""
import os
import re
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
VERSION = "14"  # another one differs in some lines


def sources():
    for folder, names, files in os.walk(ROOT):
        names[:] = [n for n in names if not n.startswith((".", "build", "obj-", "fuzz-corpus"))]
        yield from (os.path.join(folder, f) for f in sorted(files) if f.endswith((".c", ".h")))


def main():
    try:
        said = subprocess.run(["clang-format", "--version"], capture_output=True, text=True, check=True).stdout
    except FileNotFoundError:
        print("skipped: there is no clang-format")
        return 77
    if re.search(r"version (\d+)", said)[1] != VERSION:
        print(f"skipped: clang-format {VERSION} is needed: {said.strip()}")
        return 77
    files = list(sources())
    run = subprocess.run(["clang-format", "--dry-run", *files], capture_output=True, text=True, check=False, cwd=ROOT)
    wrong = re.findall(r"^(\S+):(\d+):\d+: warning", run.stderr, re.M)
    for file, line in wrong[:20]:
        print(f"{os.path.relpath(file, ROOT)}:{line}: not as clang-format has it")
    if run.returncode or len(files) < 100:
        print(f"{len(files)} files, status {run.returncode}\n{run.stderr[-500:]}")
        return 1
    print(f"{len(files)} files, {len(wrong)} places" + (": clang-format -i FILE mends them" if wrong else ""))
    return 1 if wrong else 0


sys.exit(main())
