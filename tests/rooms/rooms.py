#!/usr/bin/env python3
"""The table of rooms in docs/design/rooms.md against the sources: every folder with sources is a room, a room includes headers of the rooms
in its row, of all of these and of no other, no row names a room of a higher floor, and the includes of rooms have no circle. The same holds
for the headers of external libraries, and each library that meson.build looks for is known here."""
import os
import re
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
TABLE = "docs/design/rooms.md"
SOURCE = (".c", ".h", ".cpp", ".def")
INCLUDE = re.compile(r'^\s*#\s*include\s+["<]([^">]+)[">]', re.M)
TOPS = ("base", "client", "cluster", "daemon", "engine", "proto", "scanner", "tools")
# What a row may name beside rooms: its name in meson.build (None: for tests alone), and how its headers begin.
LIBRARIES = {
    "libc": ("threads", ()),
    "xxHash": ("libxxhash", ("xxhash.h",)),
    "SQLite": ("sqlite3", ("sqlite3.h",)),
    "protobuf-c": ("libprotobuf-c", ("protobuf-c/", "acut.pb-c.h")),
    "systemd": ("libsystemd", ("systemd/",)),
    "GeographicLib": ("geographiclib", ("GeographicLib/",)),
    "nettle": ("nettle", ("nettle/",)),
    "libpng": ("libpng", ("png.h",)),
    "libdeflate": ("libdeflate", ("libdeflate.h",)),
    "libusb": ("libusb-1.0", ("libusb",)),
    "expat": ("expat", ("expat.h",)),
    "zlib": ("zlib", ("zlib.h",)),
    "minizip": ("minizip", ("minizip/",)),
    "json-c": (None, ("json-c/", "json.h")),
}


def table():
    """By folder: floor, and the words of the column of what it may include."""
    rooms = {}
    with open(os.path.join(ROOT, TABLE), encoding="utf-8") as f:
        rows = re.findall(r"^\| (\d+) \| (`[^|]*`) \| ([^|]*) \|", f.read(), re.M)
    for floor, folders, may in rows:
        names = [n.rstrip("/") for n in re.findall(r"`([^`]*)`", folders)]
        parent = os.path.dirname(names[0])
        names = [n if "/" in n or n == names[0] else f"{parent}/{n}" for n in names]
        for name in names:
            rooms[name] = (int(floor), [w.strip() for w in may.split(",")], names)
    return rooms


def allowed(name, rooms, wrong):
    floor, words, row = rooms[name]
    may = {name}
    for word in words:
        if word in LIBRARIES:
            continue
        if word == "any":
            return set(rooms)
        if word.startswith("all of "):
            word = word.removeprefix("all of ")
        if word.startswith("each other"):
            may.update(row[:row.index(name)])
            continue
        group = {r for r in rooms if r.startswith(word + "/")}
        near = {r for r in rooms if r == word or r.endswith("/" + word)}
        # Of two rooms of a name the one of the same program.
        same = {r for r in near if r.split("/")[0] == name.split("/")[0]}
        if not group | near:
            wrong.append(f"{TABLE}: the row of {name} names {word}, which is no room and no library")
        may |= group | (same or near)
    return may


def sources(name):
    for file in sorted(os.listdir(os.path.join(ROOT, name))):
        if file.endswith(SOURCE):
            yield file, os.path.join(ROOT, name, file)


def library_of(header):
    return next((name for name, (_, begins) in LIBRARIES.items() if begins and header.startswith(begins)), None)


def check_libraries(rooms, wrong):
    """Rows and includes agree about libraries, and meson.build looks for no other one."""
    for name, (_, words, row) in rooms.items():
        named = set(words) & set(LIBRARIES) - {"libc"}
        used = {}
        for file, path in sources(name):
            with open(path, encoding="utf-8") as f:
                used.update({library_of(h): file for h in INCLUDE.findall(f.read()) if library_of(h)})
        for library in sorted(set(used) - named - ({u for u in used if LIBRARIES[u][0]} if "any" in words else set())):
            wrong.append(f"{name}/{used[library]}: includes a header of {library}, which is not in the row of {name} in {TABLE}")
        # A row of several rooms names what one of them uses.
        for library in sorted(named - set(used) if len(row) == 1 else ()):
            wrong.append(f"{TABLE}: the row of {name} names {library}, of which it includes nothing")
    with open(os.path.join(ROOT, "meson.build"), encoding="utf-8") as f:
        found = set(re.findall(r"^\s*\w+ = dependency\('([^']+)'", f.read(), re.M))
    known = {package for package, _ in LIBRARIES.values() if package}
    for package in sorted(found ^ known):
        where = "LIBRARIES in tests/rooms/rooms.py" if package in found else "meson.build"
        wrong.append(f"the library {package} is not in {where}")


def circle(uses):
    state = {}

    def visit(room, path):
        state[room] = "open"
        for other in sorted(uses[room]):
            if state.get(other) == "open":
                return path + [room, other]
            if other not in state:
                found = visit(other, path + [room])
                if found:
                    return found
        state[room] = "done"
        return None

    for room in uses:
        found = visit(room, []) if room not in state else None
        if found:
            return found[found.index(found[-1]):]
    return None


def main():
    rooms, wrong = table(), []
    owner = {}
    for top in TOPS:
        for folder, _, files in os.walk(os.path.join(ROOT, top)):
            part = os.path.relpath(folder, ROOT)
            if any(f.endswith(SOURCE) for f in files) and part not in rooms:
                wrong.append(f"{TABLE}: {part} is in no row of the table of rooms")
    for name in rooms:
        for file, _ in sources(name):
            owner.setdefault(file, set()).add(name)
    for file, of in owner.items():
        if file.endswith(".h") and len(of) > 1:
            wrong.append(f"{file} is the name of a header in {' and '.join(sorted(of))}: which one is included depends on an order")
    uses = {name: set() for name in rooms}
    for name in rooms:
        may = allowed(name, rooms, wrong)
        for other in may:
            if "any" not in rooms[name][1] and rooms[other][0] > rooms[name][0] and name.split("/")[0] == other.split("/")[0]:
                wrong.append(f"{TABLE}: the row of {name} names {other}, which is on a higher floor")
        for _, path in sources(name):
            with open(path, encoding="utf-8") as f:
                text = f.read()
            for header in INCLUDE.findall(text):
                of = owner.get(os.path.basename(header), set())
                if not of or name in of:
                    continue
                uses[name] |= of & may if of & may else of
                if not of & may:
                    wrong.append(f"{os.path.relpath(path, ROOT)}: includes {header} of {', '.join(sorted(of))}, "
                                 f"which is not in the row of {name}")
        words = set(rooms[name][1])
        if any(sources(name)) and not any(w == "any" or w.startswith(("all of", "each other")) for w in words):
            for word in sorted(words - set(LIBRARIES)):
                if not uses[name] & allowed(name, {**rooms, name: (rooms[name][0], [word], rooms[name][2])}, []) - {name}:
                    wrong.append(f"{TABLE}: the row of {name} names {word}, of which it includes nothing")
    check_libraries(rooms, wrong)
    found = circle(uses)
    if found:
        wrong.append("a circle of includes: " + " -> ".join(found))
    if len(rooms) < 30 or sum(len(u) for u in uses.values()) < 60:
        wrong.append(f"{TABLE}: {len(rooms)} rooms found: its table cannot be read")
    print("\n".join(wrong) or f"{len(rooms)} rooms, {sum(len(u) for u in uses.values())} pairs that include")
    return 1 if wrong else 0


sys.exit(main())
