"""Compares the names and types of values in the JSON of every command with acutctl-json(7), in both directions.

--write prints all names that were seen, as a help for adding one to the page.
"""
import json
import os
import re
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import ACUTCTL, Daemon, Folder, expect  # noqa: E402

PAGE = os.path.join(os.environ["ACUT_MAN"], "acutctl-json.7.scd")
SOURCE = os.path.join(os.environ["ACUT_MAN"], "..")
# Commands that print no JSON.
NO_JSON = {"geoid rm", "help"}
BASIC = {"text", "number", "boolean", "list", "object", "null"}
# Objects without fixed names: the page describes their values as name.*.
MAPS = {"removed", "classes", "returns", "return_counts", "ledger", "ledger_peak", "held", "kinds", "labels"}


def type_of(v):
    return ("null" if v is None else "boolean" if isinstance(v, bool) else "number" if isinstance(v, (int, float))
            else "text" if isinstance(v, str) else "list" if isinstance(v, list) else "object")


def walk(value, path, seen):
    """Adds path -> types for all that is in an object."""
    for key, v in value.items():
        name = path + key
        seen.setdefault(name, set()).add(type_of(v))
        inside(v, name, key, seen)


def inside(v, name, key, seen):
    if isinstance(v, dict) and key in MAPS:
        for w in v.values():
            seen.setdefault(name + ".*", set()).add(type_of(w))
            if isinstance(w, dict):
                walk(w, name + ".*.", seen)
    elif isinstance(v, dict):
        walk(v, name + ".", seen)
    elif isinstance(v, list):
        for w in v:
            seen.setdefault(name + "[]", set()).add(type_of(w))
            if isinstance(w, dict):
                walk(w, name + "[].", seen)


class Seen:
    """The printed names, by kind of object."""

    def __init__(self):
        self.kinds = {}
        self.commands = set()
        self.missing = []

    def add(self, kind, text):
        seen = self.kinds.setdefault(kind, {})
        for line in text.splitlines():
            one = {}
            walk(json.loads(line), "", one)
            tops = {k for k in one if "." not in k and "[" not in k}
            before = self.kinds.setdefault("tops " + kind, tops)
            if before != tops:
                self.missing.append("%s: %s now and then" % (kind, before ^ tops))
            for k, types in one.items():
                seen.setdefault(k, set()).update(types)


def page_kinds():
    """kind -> {path: types}, from the page; shared objects are replaced by their names."""
    kinds, shared, now = {}, {}, None
    with open(PAGE) as f:
        for line in f:
            head = re.match(r"## ([A-Z ]+)$", line)
            if head or line.startswith("# "):
                now = head and kinds.setdefault(head.group(1).lower(), {})
                continue
            entry = re.match(r"((?:\*(?:[^*\\]|\\.)+\*(?:, )?)+) \(_([a-z, ]+)_\)$", line)
            if entry and now is not None:
                for name in re.findall(r"\*((?:[^*\\]|\\.)+)\*", entry.group(1)):
                    now[name.replace("\\", "")] = set(entry.group(2).split(", "))
    shared = {k: v for k, v in kinds.items() if k in ("a lattice", "units", "an error", "a side of the disk")}
    names = {"lattice": "a lattice", "units": "units", "error": "an error", "side": "a side of the disk"}
    for kind, entries in kinds.items():
        for path, types in list(entries.items()):
            for t in types - BASIC:
                expect(t in names, "%s: %s is of the unknown type %s" % (kind, path, t))
                entries[path] = (types - {t}) | {"object"}
                for inner, inner_types in shared[names[t]].items():
                    entries["%s.%s" % (path, inner)] = inner_types
    return {k: v for k, v in kinds.items() if k not in shared}


def survey(path, points, seed=1):
    e2e.run([e2e.SYNTH, "--points", str(points), "--seed", str(seed), path]).ok()
    return path


def files(d, base, seen):
    a, b = survey(base + "/a.las", 3000), survey(base + "/b.las", 2000, 2)
    text = base + "/t.xyz"
    with open(text, "w") as f:
        f.write("0 0 1\n1 0 2\n0 1 3\n")
    with open(base + "/none.las", "w") as f:
        f.write("nothing")
    j = lambda *words, **kw: d.ctl(*words, "--json", **kw)
    seen.add("a file", j("info", a, text).ok().out + j("info", a, "--header").ok().out)
    lines = base + "/l.csv"
    with open(lines, "w") as f:
        f.write("x,y,z,name,kind\n1,2,3,a,lake\n2,2,3,a,lake\n1,2,,b,lake\n2,2,3,c,\n1,1,1,c,\n")
    seen.add("a file of lines", j("info", "--lines", lines).ok().out + j("info", "--lines", lines, "--kind-field", "kind").ok().out)
    seen.add("a pushed file", j("push", "valley", a).ok().out + j("push", "valley", a).ok().out)
    seen.add("a pushed file", j("push", "valley", b, base + "/none.las").out + j("push", "rough", b, "--scale", "0.5").ok().out)
    seen.add("a pushed file", j("push", "text", text).ok().out)
    with open(a, "ab") as f:
        f.write(b"\0")
    seen.add("a pushed file", j("push", "valley", a, "--replace").ok().out)
    degrees = base + "/degrees.xyz"
    with open(degrees, "w") as f:
        f.writelines("%.6f %.6f %d.5\n" % (9 + i % 20 * 1e-4, 47 + i // 20 * 1e-4, 400 + i % 7) for i in range(400))
    geoid = base + "/flat.pgm"
    with open(geoid, "wb") as f:
        f.write(b"P5\n# Geoid file in PGM format for the GeographicLib::Geoid class\n# Description a test\n# DateTime 2020-01-01 00:00:00\n"
                b"# Offset -108\n# Scale 0.003\n# MaxBilinearError 1.3\n# RMSBilinearError 0.2\n# MaxCubicError 0.9\n# RMSCubicError 0.1\n"
                b"# Origin 90N 0E\n# AREA_OR_POINT Point\n# Vertical_Datum WGS84\n8 5\n65535\n" + b"\x9c\x40" * 40)
    seen.add("a geoid", j("geoid", "add", geoid).ok().out + j("geoid", "list").ok().out)
    flat = base + "/flat2.pgm"
    with open(geoid, "rb") as f, open(flat, "wb") as g:
        g.write(b"".join(line for line in f.read().splitlines(True) if b"Error" not in line and b"Description" not in line and b"DateTime" not in line))
    seen.add("a geoid", j("geoid", "add", flat).ok().out)
    shift = ("--geoid", "flat", "--assume-crs", "EPSG:4326", "--assume-units", ",m")
    seen.add("a pushed file", j("push", "earth", degrees, *shift).ok().out)
    seen.add("a mesh", j("mesh", degrees, "-o", base + "/d.ply", *shift).ok().out)
    seen.add("a mesh", j("mesh", text, "-o", base + "/t.ply").ok().out)
    seen.add("a mesh", j("mesh", a, base + "/none.las", "-o", base + "/m.ply", "--max-edge", "3m").out)
    return a, b, text


def jobs(d, base, seen, text):
    j = lambda *words, **kw: d.ctl(*words, "--json", **kw)
    first, other = (j("submit", *words, "--wait").ok().out for words in (("valley", "--at", "1"), ("text",)))
    third = j("submit", "valley", "--wait").ok().out
    seen.add("a job", first + other + third)
    first, other, third = (str(json.loads(text)["job"]) for text in (first, other, third))
    seen.add("a job", j("submit", "valley", "--ground", "--bbox", "0,0,1e9,1e9", "--new").ok().out)
    seen.add("a job", j("submit", "text", "--ground", "--wait").out + j("wait", first).ok().out)
    seen.add("a job", j("jobs").ok().out + j("show", first).ok().out + j("watch", first).ok().out)
    seen.add("a mesh", j("fetch", first, "-o", base + "/f.ply").ok().out + j("fetch", other, "-o", base + "/f.ply").ok().out)
    seen.add("a mesh", j("fetch", first, "-o", base + "/tiles", "--tile", "100").ok().out)
    seen.add("a mesh", j("fetch", first, "-o", base + "/levels", "--levels").ok().out)
    seen.add("a mesh", j("fetch", first, "--sidecar", "-o", base + "/f.ply", "--origin", "auto", "-o", base + "/f.tif", "--cell", "1").ok().out)
    for name in ("f.ply", "f.tif"):
        with open("%s/%s.json" % (base, name)) as f:
            seen.add("a sidecar", json.dumps(json.load(f)))
    with open(base + "/area.wkt", "w") as f:
        f.write("POLYGON ((0 0, 1e7 0, 0 1e7))")
    seen.add("a mesh", j("fetch", first, "-o", base + "/f.ply", "--mask", base + "/area.wkt").ok().out)
    seen.add("a mesh", j("fetch", first, "-o", base + "/f.ply", "--erase", base + "/area.wkt").ok().out)
    seen.add("a mesh", j("fetch", first, "-o", base + "/f.ply", "--mask", base + "/area.wkt", "--erase", base + "/area.wkt", "--max-edge", "9",
                         "--trim-hull", "20", "--sidecar").ok().out)
    with open(base + "/f.ply.json") as f:
        seen.add("a sidecar", json.dumps(json.load(f)))
    seen.add("a mesh", j("fetch", third, "-o", base + "/c.ply", "--changed-since", "1").ok().out)
    bound = j("submit", "valley", "--max-error", "0.5", "--wait").ok().out
    seen.add("a job", bound)
    seen.add("a mesh", j("fetch", str(json.loads(bound)["job"]), "-o", base + "/f.ply").ok().out)
    seen.add("a mesh", j("fetch", first, "-o", base + "/w.ply", "--bbox", "0,0,1e6,1e7").out)
    metres = [base + "/metres.xyz", base + "/metres2.xyz"]
    for k, name in enumerate(metres):
        with open(name, "w") as f:
            f.write("0 0 1\n9 0 %d\n0 9 3\n" % (2 + k))
        seen.add("a pushed file", j("push", "metres%d" % k, name, "--assume-units", "m,m").ok().out)
    ids = [str(json.loads(j("submit", "metres%d" % k, "--wait").ok().out)["job"]) for k in (0, 1)]
    seen.add("a volume", j("volume", *ids, "--cell", "1", "-o", base + "/v.png").ok().out + j("volume", ids[0], "--level", "1.5").ok().out)
    with open(base + "/part.geojson", "w") as f:
        f.write('{"type":"Feature","properties":{"name":"p"},"geometry":{"type":"Polygon","coordinates":[[[0,0],[4,0],[0,4],[0,0]]]}}')
    seen.add("a volume", j("volume", *ids, "--within", base + "/part.geojson").ok().out)
    job = json.loads(j("submit", "text", "--new", "--wait").ok().out)["job"]
    seen.add("a job", j("cancel", str(job)).ok().out)
    seen.add("a removed job", j("rm", str(job)).ok().out)
    seen.add("a plan", j("plan", "valley").ok().out + j("plan", "text").ok().out +
             j("plan", "valley", "--max-error", "0.5123").ok().out)
    for words in (("show", "999"), ("submit", "nothing"), ("mesh", base + "/none.las", "-o", base + "/x.ply")):
        got = j(*words)
        expect(got.status not in (0, 3), "%s" % (words,))
        seen.add("a failure", got.out)
    seen.add("a failure", e2e.run([ACUTCTL, "mesh", text, "--rubbish", "--json"]).out)


def datasets(d, base, seen, text):
    j = lambda *words, **kw: d.ctl(*words, "--json", **kw)
    own = str(os.getuid()), str(os.getgid())
    seen.add("a dataset", j("dataset", "create", "empty").ok().out + j("dataset", "chmod", "660", "empty").ok().out)
    seen.add("a dataset", j("dataset", "chown", own[0], "empty").ok().out + j("dataset", "chgrp", own[1], "empty").ok().out)
    seen.add("a dataset", j("datasets").ok().out + j("dataset", "show", "valley").ok().out + j("dataset", "show", "valley", "--at", "1").ok().out)
    seen.add("a dataset", j("dataset", "pin", "rough").ok().out + j("dataset", "unpin", "rough").ok().out)
    seen.add("a reverted dataset", j("dataset", "revert", "valley", "2").ok().out)
    seen.add("a generation", j("dataset", "log", "valley").ok().out + j("dataset", "log", "valley", "--files").ok().out)
    seen.add("a pruned dataset", j("dataset", "prune", "valley", "--keep", "1").ok().out)
    seen.add("discarded pushes", j("dataset", "discard", "valley", "--all").ok().out)
    seen.add("a copy", j("dataset", "export", "text", base + "/export").ok().out + j("backup", base + "/backup").ok().out)
    seen.add("an import", j("dataset", "import", base + "/export", "again").ok().out)
    seen.add("a dataset", j("dataset", "rm", "again").ok().out + j("datasets", "--removed").ok().out + j("dataset", "restore", "again").ok().out)


def the_rest(d, base, seen):
    j = lambda *words, **kw: d.ctl(*words, "--json", **kw)
    seen.add("the status", j("status").ok().out)
    seen.add("the disk", j("cache", "stat").ok().out)
    seen.add("what was freed", j("cache", "gc", "--all").ok().out)
    subprocess.run([os.environ["EMPTY_WORK"], base + "/work", "3"], check=True)
    seen.add("what was adopted", j("cache", "adopt", base + "/work").ok().out)
    seen.add("what was verified", j("cache", "verify").ok().out)
    for folder, _, names in os.walk(d.state + "/datasets"):
        for name in names:
            if name.endswith(".seg"):
                with open(os.path.join(folder, name), "r+b") as f:
                    f.seek(os.path.getsize(f.name) // 2)
                    f.write(b"\xff" * 64)
    lines = j("cache", "verify").out.splitlines()
    expect(len(lines) > 1, "no damage is found: %s" % lines)
    seen.add("a damage", "\n".join(lines[:-1]))
    seen.add("a setting", j("config", "show").ok().out)
    seen.add("a metric", j("metrics").ok().out)
    seen.add("a visit of the doctor", j("doctor").out)
    os.mkdir(base + "/drop")
    survey(base + "/drop/new.las", 500, 3)
    with open(base + "/drop/bad.las", "w") as f:
        f.write("nothing")
    seen.add("an ingested file", j("ingest", "dropped", base + "/drop", "--settle", "0").out)
    seen.add("the version", j("version").ok().out)
    seen.add("a sign of life", j("ping").ok().out)
    seen.add("a format", j("formats").ok().out)
    expect(not j("geoid", "rm", "flat2").ok().out, "geoid rm prints something")


def fits(seen, page, write):
    faults = []
    for kind in sorted(set(page) | {k for k in seen.kinds if not k.startswith("tops ")}):
        got, said = seen.kinds.get(kind, {}), page.get(kind, {})
        if write:
            print("## %s\n" % kind.upper())
            for path, types in got.items():
                print("*%s* (_%s_)" % (path, ", ".join(sorted(types))))
            print()
            continue
        for path in sorted(set(got) | set(said)):
            if path not in said:
                faults.append("%s: %s (%s) is not in the page" % (kind, path, ", ".join(sorted(got[path]))))
            elif path not in got:
                # names within an object that may be null, or within an empty list, may be missing
                if "." not in path and "[" not in path:
                    faults.append("%s: %s of the page was not printed" % (kind, path))
            elif got[path] - said[path]:
                faults.append("%s: %s is %s, the page says %s" % (kind, path, sorted(got[path]), sorted(said[path])))
    expect(not faults and not seen.missing, "\n".join(faults + seen.missing))


def all_commands():
    """The commands in their tables, those with verbs as "dataset show"."""
    def rows(file):
        with open(os.path.join(SOURCE, "client/acutctl", file)) as f:
            return re.findall(r'^\t\{"(\w+)", "([^{]*)\}', f.read(), re.M)
    plain, spoken = set(), set()
    for name, row in rows("ctl_command.c"):
        if re.search(r"ctl_\w+_verbs", row):
            spoken |= {"%s %s" % (name, verb) for verb, _ in rows("ctl_%s.c" % name)}
        else:
            plain.add(name)
    expect(len(plain) > 18 and len(spoken) > 18, "commands: %s %s" % (plain, spoken))
    return plain | spoken


def names_of_all():
    with Folder() as base:
        seen = Seen()
        with Daemon(base, memory="64M") as d:
            ctl = d.ctl
            d.ctl = lambda *words, **kw: (seen.commands.update([words[0], " ".join(words[:2])] if "--json" in words else [])
                                          or ctl(*words, **kw))
            a, b, text = files(d, base, seen)
            jobs(d, base, seen, text)
            datasets(d, base, seen, text)
            the_rest(d, base, seen)
        write = "--write" in sys.argv
        fits(seen, {} if write else page_kinds(), write)
        missing = all_commands() - NO_JSON - seen.commands
        expect(not missing, "run by none of this test with --json: %s" % sorted(missing))


def words_of_tables():
    """The page has the same codes of errors and states of jobs as the source; jobs.md has each state."""
    with open(PAGE) as f:
        page = f.read()
    for name, table, after in (("codes", "base/err.def", r"\*code\* .*\n((?:\t.*\n)+)"), ("states", "daemon/job/job_state.def", r"\*state\* .*\n((?:\t.*\n)+)")):
        with open(os.path.join(SOURCE, table)) as f:
            source = set(re.findall(r'^[A-Z_]+\(\w+, *"([a-z-]+)"', f.read(), re.M))
        said = set(re.findall(r"\*([a-z-]+)\*", re.search(after, page).group(1)))
        if name == "states":
            with open(os.path.join(SOURCE, "docs/design/jobs.md")) as f:
                drawn = set(re.findall(r"[a-z-]+", re.search(r"```(.*?)```", f.read(), re.S).group(1)))
            expect(not source - drawn, "states of %s that the picture of docs/design/jobs.md lacks: %s" % (table, sorted(source - drawn)))
        source |= {"waiting-space"} if name == "states" else set()  # printed in place of any state
        expect(len(source) > 1, "no %s in %s" % (name, table))
        expect(not source - said, "%s of %s that acutctl-json(7) lacks: %s" % (name, table, sorted(source - said)))
        expect(not said - source, "%s of acutctl-json(7) that %s lacks: %s" % (name, table, sorted(said - source)))


e2e.main(names_of_all, words_of_tables)
