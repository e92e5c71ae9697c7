"""acutctl without a daemon: what is understood, what is refused and how, exit statuses, JSON, help and man page."""
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "../e2e"))
from checks import check, end  # noqa: E402

ACUTCTL = os.environ["ACUTCTL"]
MAN = os.environ.get("ACUT_MAN")
BUILD = os.environ.get("ACUT_BUILD", "build")


def run(*args, env=None, cwd=None, stdin=b"", out=subprocess.PIPE):
    full = {k: v for k, v in os.environ.items() if not k.startswith(("ACUT_", "XDG_"))}
    full["ACUT_SOCKET"] = "/nonexistent/acutd.sock"
    full.update(env or {})
    p = subprocess.run([ACUTCTL, *args], input=stdin, stdout=out, stderr=subprocess.PIPE, env=full, cwd=cwd, timeout=e2e.PATIENCE)
    return p.returncode, (p.stdout or b"").decode(), p.stderr.decode()


def expect(args, status, *texts, **kw):
    got, out, err = run(*args, **kw)
    check(" ".join(args), got == status and all(t in out + err for t in texts),
          "\n  status %d, wanted %d %s\n  %s%s" % (got, status, texts, out, err))
    return out, err


def options_of(command):
    out = run("help", command)[1]
    return set(re.findall(r"--([a-z][a-z-]*)", "\n".join(l for l in out.splitlines() if l.startswith("  "))))


COMMANDS = re.findall(r"^  acutctl (\S+)", run("help")[1], re.M)


def usage(base):
    survey = os.path.join(base, "a.xyz")
    with open(survey, "w") as f:
        f.write("0 0 0\n1 0 0\n0 1 0\n")
    out = os.path.join(base, "m.ply")
    expect([], 2, "no command")
    expect(["nonsense"], 2, "there is no command nonsense")
    expect(["mesh"], 2, "mesh needs at least 1 word", "acutctl mesh INPUT... -o OUT")
    expect(["push", "valley"], 2, "push needs at least 2 words after it, 1 given")
    expect(["jobs", "valley"], 2, "jobs takes no word \"valley\"")
    expect(["mesh", survey], 2, "no output", "-o OUT")
    expect(["mesh", survey, "-o"], 2, "needs a value")
    expect(["mesh", survey, "--rubbish"], 2, "no option --rubbish")
    expect(["mesh", survey, "-o", out, "--quiet=1"], 2, "takes no value")
    expect(["mesh", survey, "-o", out, "--class", "2", "--class", "3"], 2, "given twice")
    expect(["mesh", survey, "-o", base + "/m.foo"], 2, "does not give a format", "--format")
    expect(["mesh", survey, "-o", out, "--format", "3mf"], 2, "no output format 3mf")
    expect(["mesh", survey, "-o", out, "-o", out], 2, "given twice")
    expect(["mesh", survey, "-o", "-"], 69)
    expect(["push", "x", survey, survey, "--name", "T1"], 2, "one input, and there are 2")
    expect(["push", "x", "-", "--input-format", "laz", "--name", "a/T1"], 2, "without slashes")
    expect(["mesh", survey, "-o", survey], 2, "one of the inputs")
    os.link(survey, base + "/same.ply")
    expect(["mesh", survey, "-o", base + "/same.ply"], 2, "one of the inputs")
    expect(["mesh", "-", "-o", out], 2, "--input-format")
    expect(["mesh", survey, "-o", out, "--class", "300"], 2, "not a list of classes")
    expect(["mesh", survey, "-o", out, "--returns", "third"], 2, "--returns")
    expect(["mesh", survey, "-o", out, "--ground", "--surface"], 2, "at once")
    for words, said in ((("--not-class", "7-"), "not a list of classes"), (("--zmin", "low"), "--zmin is not a height"),
                        (("--zmin", "3.5", "--zmax", "3.49"), "no height is left"), (("--zmax", "1,5"), "--zmax"),
                        (("--every", "0"), "--every"), (("--thin", "0"), "--thin is not a length"),
                        (("--thin", "10km"), "--thin is not a length"), (("--thin", "-1m"), "--thin is not a length"),
                        (("--thin", "5", "--thin-pick", "best"), "--thin-pick is"), (("--thin-pick", "lowest"), "--thin CELL"),
                        (("--crop", "0,0,5"), "not X1,Y1,X2,Y2"), (("--crop", "0,0,5,x"), "X1,Y1,X2,Y2"),
                        (("--crop", "5,0,0,5"), "is empty"), (("--crop", "0,0,5,-1e-3"), "is empty")):
        expect(["mesh", survey, "-o", out, *words], 74 if words[1] == "0,0,5,x" else 2, said)
    expect(["mesh", survey, "-o", out, "--max-edge", "-3"], 2, "--max-edge")
    expect(["mesh", survey, "-o", out, "--trim-hull", "0"], 2, "--trim-hull is not a length")
    expect(["mesh", survey, "-o", out, "--origin", "1,2"], 2, "--origin")
    expect(["mesh", survey, "-o", out, "--origin", "1,2,3,4"], 2, "--origin")
    expect(["mesh", survey, "-o", out, "--polyface"], 2, "--polyface has no meaning for ply")
    expect(["mesh", survey, "-o", out, "--width", "100"], 2, "--width is for pictures")
    expect(["mesh", survey, "-o", base + "/m.png", "--canonical"], 2, "--canonical has no meaning")
    expect(["mesh", survey, "-o", out, "--canonical", "-o", base + "/m.png", "--canonical"], 2, "--canonical has no meaning for png", "m.png")
    expect(["mesh", survey, "-o", base + "/m.png", "--width", "9", "-o", out, "--width", "9"], 2, "--width has no meaning for ply", "m.ply")
    expect(["mesh", survey, "-o", base + "/m.png", "--width", "9", "--width", "9", "-o", out], 2, "--width is given twice")
    expect(["mesh", survey, "--width", "9", "-o", base + "/m.png", "--width", "none"], 2, "--width")
    expect(["mesh", survey, *["-o%s/%d.ply" % (base, i) for i in range(17)]], 2, "--output is given more than 16 times")
    expect(["mesh", survey, "-o", base + "/m.png", "--width", "0"], 2, "--width")
    expect(["mesh", survey, "-o", base + "/m.png", "--color", "red"], 2, "--color")
    expect(["mesh", survey, "-o", out, "--timeout", "soon"], 2, "--timeout")
    expect(["mesh", survey, "-o", out, "--memory", "23M"], 2, "24M")
    expect(["mesh", survey, "-o", out, "--threads", "0"], 2, "--threads")
    expect(["mesh", survey, "-o", out, "--memory", "64M", "--socket", "x"], 2, "own")
    expect(["mesh", survey, "-o", base, "--format", "ply"], 2, "folder")
    expect(["mesh", survey, "-o", out, "--format", "null"], 2, "null writes nothing")
    expect(["mesh", survey, "-o", "-", "--format", "null"], 2, "null writes nothing")
    expect(["mesh", survey, "--format", "null", "--canonical"], 2, "--canonical has no meaning for null")
    expect(["mesh", survey, "--format", "ply"], 2, "no output given")
    expect(["fetch", "1", "--format", "ply"], 2, "no output given")
    expect(["fetch", "1", "--format", "null"], 69)
    expect(["mesh", survey, "-o", base + "/none/m.ply"], 74, "none")
    expect(["mesh", base + "/empty", "-o", out], 69)
    os.mkdir(base + "/empty")
    expect(["mesh", base + "/empty", "-o", out], 1, "no survey files")
    open(out, "w").close()
    expect(["mesh", survey, "-o", out, "--no-clobber"], 2, "exists", "--no-clobber")
    os.unlink(out)
    expect(["jobs", "--class", "2"], 2, "jobs takes no --class")
    expect(["push", "x", survey, "-o", out], 2, "push takes no --output")
    expect(["show", "first"], 2, "not the number of a job")
    expect(["wait", "1", "two"], 2, "not the number of a job")
    expect(["fetch", "1"], 2, "no output")
    expect(["dataset", "show"], 2)
    expect(["dataset", "hide", "x"], 2, "no command dataset hide")
    areas(base, survey, out)
    check("nothing is left behind", sorted(os.listdir(base)) == ["a.xyz", "empty", "same.ply"], str(os.listdir(base)))


def areas(base, survey, out):
    """An invalid area is refused with its file and place, before a daemon is asked."""
    path = base + "/area"
    ring = "[[0,0],[9,0],[9,9],[0,0]]"
    for text, *said in (
            ("", "line 1", "text ends"), ("POINT (1 2)", "POLYGON or MULTIPOLYGON"), ("POLYGON ((0 0, 1 1, 2", "ends where a number"),
            ("POLYGON ((0 0, 1 1,\n 2 x))", "line 2", '"x))", where a number', "byte 23"), ("POLYGON EMPTY", "no polygon"),
            ("POLYGON ((0 0, 1 0, 1 1, 0 0)) x", "POLYGON"), ("SRID=1;POLYGON ((0 0))", "SRID"),
            ("POLYGON ((0 0, 1 0, 1.2345678901234567891 1))", "18 digits"), ("POLYGON (0 0, 1 0, 1 1)", "start of a ring"),
            ("POLYGON ((0 0, 1e-39 0, 1e9 1))", "common unit"), ("POLYGON ((1 2 3 4 5, 1 2))", '"," or ")"'),
            ('{"type":"Polygon","coordinates":[' + ring, "ends where a ]", "no GeoJSON"), ('{"type":"Point","coordinates":[1,2]}', "Point is no area"),
            ('{"a":1}', "no type"), ('{"type":"Polygon"}', "coordinates", "no coordinates"),
            ('{"type":"Polygon","coordinates":[[[0,0],[1,"b"]]]}', "coordinates[0][1]", "not a number"),
            ('{"type":"Polygon","coordinates":[[[0,0],[1]]]}', "coordinates[0][1]", "two numbers"),
            ('{"type":"FeatureCollection","features":[{"type":"Feature","geometry":{"type":"LineString","coordinates":[]}}]}',
             "features[0].geometry", "LineString is no area"),
            ('{"type":"Polygon","coordinates":[[[0,0],[1,99999999999999999999]]]}', "exactly"),
            ('{"type":"FeatureCollection","features":[]}', "no polygon")):
        with open(path, "w") as f:
            f.write(text)
        expect(["mesh", survey, "-o", out, "--crop", path], 1, path, *said)
    with open(path, "w") as f:
        f.write("POLYGON ((" + ",".join("%d.%03d %d.5" % (i % 7, i % 1000, i) for i in range(30000)) + "))")
    expect(["mesh", survey, "-o", out, "--crop", path], 1, "30000 corners", "simplify")
    os.unlink(path)
    expect(["mesh", survey, "-o", out, "--crop", path], 74, path, "GeoJSON or WKT")
    expect(["mesh", survey, "-o", out, "--crop", base], 1, base, "not a file")


def unreachable(base):
    expect(["doctor"], 69, "socket", "wrong")
    expect(["metrics"], 69, "no daemon")


def no_daemon(base):
    survey = os.path.join(base, "a.xyz")
    none = {"ACUT_SOCKET": "", "HOME": base, "PATH": "/nonexistent", "ACUT_ACUTD": ""}
    for words in (["ping"], ["status"], ["jobs"], ["datasets"], ["show", "1"], ["submit", "x"], ["plan", "x"], ["push", "x", survey],
                  ["dataset", "log", "x"], ["dataset", "revert", "x", "2"], ["dataset", "show", "x", "--at", "2"],
                  ["fetch", "1", "-o", base + "/m.ply"], ["cancel", "1"], ["rm", "1"], ["wait", "1"], ["watch"]):
        expect(words, 69, "no daemon")
        expect(words, 69, "--private", env=none) if not os.path.exists("/run/acut/acutd.sock") else None
    expect(["mesh", survey, "-o", base + "/m.ply"], 69)
    expect(["mesh", survey, "-o", base + "/m.ply", "--private"], 69, env={"ACUT_ACUTD": "/nonexistent/acutd", "HOME": base,
                                                                         "XDG_RUNTIME_DIR": base})
    out, _ = expect(["ping", "--json"], 69)
    error = json.loads(out)["error"]
    check("JSON of an error", set(error) == {"code", "file", "offset", "field", "message", "hint"} and error["code"] == "no-daemon",
          out)
    expect(["mesh", survey, "-o", "-", "--format", "ply", "--json"], 69)
    out, err = run("mesh", survey, "-o", "-", "--format", "ply", "--json")[1:]
    check("JSON goes to stderr where OUT is -", out == "" and json.loads(err)["error"]["code"] == "no-daemon", out + err)
    check("no output of a failure", not os.path.exists(base + "/m.ply"))


def wrong_daemon(base):
    """A server that is not acutd, or closes the connection at once, leads to an error, never a hang."""
    path = os.path.join(base, "s.sock")
    server = socket.socket(socket.AF_UNIX)
    server.bind(path)
    server.listen(8)

    def serve():
        while True:
            try:
                c, _ = server.accept()
            except OSError:
                return
            c.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n" if serve.talks else b"")
            c.close()
    serve.talks = False
    t = threading.Thread(target=serve, daemon=True)
    t.start()
    got, _, err = run("ping", "--socket", path)
    check("a daemon that goes away", got == 69, "%d %s" % (got, err))
    serve.talks = True
    got, _, err = run("ping", "--socket", path)
    check("not a daemon", got in (69, 76), "%d %s" % (got, err))
    server.close()
    silent = socket.socket(socket.AF_UNIX)
    silent.bind(path + "2")
    silent.listen(8)
    got, _, err = run("ping", "--socket", path + "2", "--timeout", "0.5")
    check("a daemon that says nothing", got == 124 and "0.5" in err, "%d %s" % (got, err))
    silent.close()


def slow_input(base):
    """--timeout and signals work while standard input never ends. With a daemon and folders of its own."""
    env = {k: v for k, v in os.environ.items() if not k.startswith("ACUT_")}
    for what in ("STATE_HOME", "CACHE_HOME", "RUNTIME_DIR"):
        env["XDG_" + what] = os.path.join(base, what)
        os.mkdir(env["XDG_" + what], 0o700)
    for how in ("timeout", "signal"):
        r, w = os.pipe()
        p = subprocess.Popen([ACUTCTL, "mesh", "-", "--input-format", "xyz", "-o", base + "/m.ply", "--threads", "1"]
                             + (["--timeout", "0.3"] if how == "timeout" else []), stdin=r, stderr=subprocess.PIPE, env=env)
        os.close(r)
        if how == "signal":
            e2e.handles(p, signal.SIGTERM)
            time.sleep(0.4)  # it reads
            p.terminate()
        p.communicate(timeout=e2e.PATIENCE)
        os.close(w)
        check("input that never ends, " + how, p.returncode == (124 if how == "timeout" else 143), str(p.returncode))


def files_of_lines(base):
    """A layer without features, or one that is not asked for, before one that has some."""
    def drawing(*layers):
        path = os.path.join(base, "two.dxf")
        with open(path, "w") as f:
            f.write("0\nSECTION\n2\nENTITIES\n")
            for name in layers:
                f.write("0\nLINE\n8\n%s\n10\n0\n20\n0\n30\n1\n11\n2\n21\n2\n31\n2\n" % name)
            f.write("0\nENDSEC\n0\nEOF\n")
        return path

    two = drawing("A", "B")
    out, _ = expect(["info", two], 0, "layer     A: 1", "layer     B: 1")
    check("one system is shown once", out.count("  crs ") == 1, out)
    for name in ("A", "B"):
        out, _ = expect(["info", "--layer", name, two], 0, "layer     %s: 1" % name)
        check("only that layer, with its system", out.count("  layer ") == 1 and out.count("  crs ") == 1, out)
    # What the file does not say is unknown: a number alone tells no unit.
    for crs, degrees in (("", True), ('"crs": "EPSG:4326",', True), ('"crs": "EPSG:4258",', None), ('"crs": "EPSG:25832",', None)):
        path = os.path.join(base, "l.geojson")
        with open(path, "w") as f:
            f.write('{%s "type": "LineString", "coordinates": [[1, 2, 3], [4, 5, 6]]}' % crs)
        layer = json.loads(run("info", "--json", path)[1])["layers"][0]
        check("degrees of " + crs, layer["degrees"] is degrees, str(layer))
    with open(two) as f:
        text = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n6\n0\nENDSEC\n" + f.read()
    with open(two, "w") as f:
        f.write(text)
    layer = json.loads(run("info", "--json", two)[1])["layers"][0]
    check("a drawing in metres", layer["unit"] == "metre" and layer["degrees"] is False, str(layer))


def texts():
    expect(["--version"], 0, "acutctl ")
    expect(["version", "--json"], 0, '{"version":"')
    out = expect(["help"], 0)[0]
    for c in COMMANDS:
        check("help lists " + c, re.search(r"^  acutctl %s\b" % c, out, re.M), out)
        expect([c, "--help"], 0, "acutctl " + c)
        if c != "help":
            check("help of %s is the same twice" % c, run("help", c)[1] == run(c, "-h")[1])
    check("help of a verb is that of its command", run("help", "dataset", "chmod")[1] == run("help", "dataset")[1] != "")
    expect(["help", "push", "chmod"], 2, "no word \"chmod\"")
    expect(["help", "push", "a", "b"], 2, "no word \"b\"")
    expect(["formats"], 0, "ply", "obj", "landxml", "dxf", "glb", "stl", "html", "png", "las", "xyz")
    rows = [json.loads(line) for line in run("formats", "--json")[1].splitlines()]
    check("formats as JSON", {r["format"] for r in rows} >= {"ply", "obj", "landxml", "dxf", "glb", "stl", "html", "png", "null", "las", "xyz"})
    with open("/dev/full", "w") as full:
        check("a full standard output", run("formats", out=full)[0] == 74)
    r, w = os.pipe()
    os.close(r)
    check("a closed standard output", run("formats", out=w)[0] == 141)
    os.close(w)


def suggestions():
    """After a typing error acutctl suggests the nearest name, or none if no name is near."""
    for words, said in ((["mehs", "a"], "did you mean acutctl mesh?"), (["datset"], "did you mean acutctl dataset?"),
                        (["statsu"], "did you mean acutctl status?"), (["subm", "x"], "did you mean acutctl submit?"),
                        (["log", "valley"], "did you mean acutctl dataset log?"), (["dataset", "craete", "x"], "did you mean create?"),
                        (["cache", "stats"], "did you mean stat?"), (["geoid", "ad", "x"], "did you mean add?"),
                        (["mesh", "a", "--retruns", "all"], "did you mean --returns?"), (["mesh", "a", "--grund"], "did you mean --ground?"),
                        (["mesh", "a", "--max-egde=3"], "did you mean --max-edge?"), (["mesh", "a", "--returns", "frist"], "did you mean first?"),
                        (["mesh", "a", "--duplicates=higest"], "did you mean highest?"), (["submit", "a", "--priority", "hgih"], "did you mean high?"),
                        (["help", "mehs"], "did you mean acutctl mesh?"), (["help", "dataset", "chmd"], "did you mean chmod?")):
        out, err = expect(words, 2, said)
        check("one sentence and a hint: " + " ".join(words), len(err.splitlines()) == 2 and err.startswith("acutctl: there is no ")
              or " is " in err.splitlines()[0], err)
    for words in (["xyzzy"], ["mesh", "a", "--xyzzy"], ["dataset", "xyzzy", "a"], ["mesh", "a", "--returns", "xyzzy"]):
        check("nothing is near " + words[-1], "did you mean" not in expect(words, 2)[1])


def examples():
    """The command lines in the help are valid: there is no usage error."""
    with tempfile.TemporaryDirectory(prefix="acut-cli-") as base:
        for name in ("monday/a.xyz", "delivery-2/a.xyz", "survey.laz"):
            os.makedirs(os.path.dirname(os.path.join(base, name)), exist_ok=True)
            with open(os.path.join(base, name), "w") as f:
                f.write("0 0 0\n")
        for c in COMMANDS:
            lines = re.findall(r"^  (acutctl (?:%s) ?.*)$" % c, run("help", c)[1].split("examples:")[-1].split("exit status:")[0], re.M)
            check("help of %s has an example" % c, lines, c)
            for line in lines:
                got, out, err = run(*line.split()[1:], cwd=base)
                check(line, got != 2, "%d %s" % (got, err))


def plain():
    """There are no escape sequences without a terminal, and never those of a name."""
    for words in (["help"], ["help", "mesh"], ["formats"], ["status"], ["mesh", "a\033[31mb\nc.las", "-o", "m.ply"], ["\033]0;x\007"],
                  ["mesh", "--\033[1m"]):
        out, err = run(*words, env={"CLICOLOR_FORCE": "1"})[1:]
        check("no control characters: %r" % words, not re.search(r"[^\n\t\x20-\x7e]", out + err), repr(out + err))


def man_page():
    """--help and the man page have the same options."""
    if not MAN:
        print("skipped: the man pages (ACUT_MAN is not set)")
        return
    with open(os.path.join(MAN, "acutctl.1.scd")) as f:
        page = f.read()
    known = set()
    for c in COMMANDS:
        check("man page has " + c, re.search(r"^\*%s\*" % c, page, re.M), c)
        known |= options_of(c)
    for o in known:
        check("man page has --" + o, "*--%s*" % o in page, o)
    for o in set(re.findall(r"\*--([a-z-]+)\*", page)):
        check("acutctl knows --%s of its man page" % o, o in known, o)
    for name, section in (("acutd", 8), ("acut-synth", 1), ("acut-verify", 1), ("acut-domain", 1), ("acut-grid-dump", 1)):
        program = os.path.join(BUILD, "daemon" if name == "acutd" else "tools", name)
        if not os.access(program, os.X_OK):
            print("skipped: the man page of %s, which is not built" % name)
            continue
        # The page of acutd is made from the table of settings.
        with open(os.path.join(os.path.join(BUILD, "man") if name == "acutd" else MAN, "%s.%d.scd" % (name, section))) as f:
            page = f.read()
        text = subprocess.run([program, "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=e2e.PATIENCE).stdout.decode()
        for o in set(re.findall(r"(?<![\w-])--([a-z][a-z-]+)", text)):
            check("man page of %s has --%s" % (name, o), "*--%s*" % o in page, o)
        if name not in ("acut-domain", "acut-grid-dump"):
            continue
        # Both are made of one table: what the page has is in the help, and what the help has is understood.
        for o in set(re.findall(r"^\*--([a-z-]+)\*", page, re.M)):
            check("--help of %s has --%s" % (name, o), re.search(r"(?<![\w-])--%s(?![\w-])" % o, text), text)
        for o, value in re.findall(r"^  --([a-z-]+)(?: ([A-Z]+))?", text, re.M):
            words = ["--" + o] + (["1M"] if value else [])
            r = subprocess.run([program, *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=e2e.PATIENCE)
            said = r.stdout.decode()
            check("%s understands --%s" % (name, o), r.returncode in ((0,) if o in ("help", "version") else (2, 74)) and "ecogni" not in said and
                  "ambiguous" not in said and (o in ("help", "version") or re.search("want|give a FILE|1M: cannot open", said)), said)
        r = subprocess.run([program, "--none"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
        check("%s refuses another option" % name, r.returncode == 2 and b"--none" in r.stderr and b"--help" in r.stderr, repr(r))


def libraries():
    """A library that few commands need is not linked, but loaded when it is needed (ctl_sha.c)."""
    out = subprocess.run([ACUTCTL], env=dict(os.environ, LD_TRACE_LOADED_OBJECTS="1"), stdout=subprocess.PIPE, timeout=e2e.PATIENCE).stdout
    check("the loader tells the libraries", b"libc.so" in out, repr(out))
    check("libcrypto is not one of them", b"libcrypto" not in out, repr(out))


with tempfile.TemporaryDirectory(prefix="acut-cli-") as d:
    usage(d)
    unreachable(d)
    no_daemon(d)
    wrong_daemon(d)
    slow_input(d)
    files_of_lines(d)
texts()
suggestions()
examples()
plain()
libraries()
man_page()
end()
