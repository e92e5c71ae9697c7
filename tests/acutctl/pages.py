"""The manual: groff has no warnings, the examples run, and tables agree with the source in both directions."""
import os
import re
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import ACUTCTL, Daemon, Folder, expect  # noqa: E402

SOURCE, BUILT = os.environ["ACUT_SOURCE"], os.environ["ACUT_MAN_BUILT"]
MAN = os.path.join(SOURCE, "man")


def text_of(name):
    with open(os.path.join(MAN, name)) as f:
        return f.read()


def pages():
    return sorted(n for n in os.listdir(MAN) if n.endswith(".scd"))


def section(page, title):
    found = re.search(r"^# %s\n(.*?)(?=^# |\Z)" % re.escape(title), page, re.M | re.S)
    expect(found, "no section " + title)
    return found.group(1)


def groff_is_silent():
    built = [os.path.join(BUILT, n) for n in sorted(os.listdir(BUILT)) if re.search(r"\.[1-8]$", n)]
    names = {n[:-4] for n in pages()}
    expect({os.path.basename(n) for n in built} == names, "built %s of %s" % (built, names))
    if not shutil.which("groff"):
        e2e.unavailable("groff is not installed")
    for page in built:
        p = subprocess.run(["groff", "-man", "-t", "-ww", "-Kutf8", "-Tutf8", "-z", page], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=e2e.PATIENCE)
        expect(p.returncode == 0 and not p.stdout, "%s: %s" % (page, p.stdout.decode()))


def all_pages_are_known():
    """Each page is listed in acut(7) and has an example, and all names in it exist."""
    names = {n[:-4] for n in pages()}
    overview = section(text_of("acut.7.scd"), "PAGES")
    listed = {"%s.%s" % m for m in re.findall(r"\*([a-z.-]+)\*\((\d)\)", overview)}
    expect(listed | {"acut.7"} == names, "acut(7) lists %s" % sorted(listed ^ (names - {"acut.7"})))
    for name in names:
        page = text_of(name + ".scd")
        expect(re.search(r"^# EXAMPLE|^\t\$ |^```", page, re.M), "%s has no example" % name)
        for other in re.findall(r"\*(acut[a-z.-]*)\*\((\d)\)", page):
            expect("%s.%s" % other in names, "%s names %s(%s)" % ((name,) + other))


def statuses_and_environment():
    page = text_of("acutctl.1.scd")
    with open(os.path.join(SOURCE, "base/err.def")) as f:
        source = {int(n) for n in re.findall(r'^ERR\(\w+, *"[a-z-]+", *(\d+)', f.read(), re.M)}
    source |= {0, 3, 130, 143, 129, 141}  # done; some were refused; signals
    said = {int(n) for n in re.findall(r"\*(\d+)\*", "\n".join(line for line in section(page, "EXIT STATUS").splitlines() if line.startswith("*")))}
    expect(said == source, "exit statuses: %s" % (said ^ source))
    # Each code is listed under its status only.
    with open(os.path.join(SOURCE, "base/err.def")) as f:
        codes = {code: int(n) for code, n in re.findall(r'^ERR\(\w+, *"([a-z-]+)", *(\d+)', f.read(), re.M)}
    told, status = {}, None
    for line in section(page, "EXIT STATUS").splitlines():
        if re.match(r"\*\d+\*", line):
            status = int(re.match(r"\*(\d+)\*", line).group(1))
        for code in re.findall(r"\*([a-z][a-z-]*)\*", line):
            told.setdefault(code, []).append(status)
    expect(told == {code: [n] for code, n in codes.items()}, "codes of statuses: %s" % {k: (told.get(k), codes.get(k)) for k in
           set(told) | set(codes) if told.get(k) != [codes.get(k)]})
    names = set()
    for folder in ("client", "base"):
        for root, _, files in os.walk(os.path.join(SOURCE, folder)):
            for n in files:
                if n.endswith(".c"):
                    with open(os.path.join(root, n)) as f:
                        names |= set(re.findall(r'(?:getenv|xdg)\("([A-Z_]+)"', f.read()))
    names -= {"PATH", "JOURNAL_STREAM"}  # where programs are; of the daemon
    said = set(re.findall(r"\*([A-Z_]{4,})\*", "\n".join(line for line in section(page, "ENVIRONMENT").splitlines() if line.startswith("*"))))
    expect(names == said, "environment: %s" % (names ^ said))


def verbs():
    """acutctl(1) has exactly the verbs of the commands."""
    page = section(text_of("acutctl.1.scd"), "COMMANDS")
    for command in re.findall(r"^  acutctl (\S+)", e2e.run([ACUTCTL, "help"]).out, re.M):
        known = set(re.findall(r"^  acutctl %s ([a-z]+)" % command, e2e.run([ACUTCTL, "help", command]).out.split("options")[0], re.M))
        said = set(re.findall(r"\*%s\* \*([a-z]+)\*" % command, "\n".join(line for line in page.splitlines() if line.startswith("*"))))
        expect(known == said, "verbs of %s: %s" % (command, known ^ said))


def examples_run():
    """The lines of the pages that begin with "$ acutctl" (or "$ acut-verify", "$ acut-synth"), in order, each page with a daemon of its own."""
    for name in ("acut.7.scd", "acutctl.1.scd", "acutctl-json.7.scd", "acut-synth.1.scd", "acut-verify.1.scd"):
        lines = re.findall(r"^\t?\$ (acut(?:ctl|-synth|-verify) .*?)(?:\+\+)?$", text_of(name), re.M)
        expect(lines, name + " has no example to run")
        with Folder() as base:
            os.mkdir(base + "/monday")
            os.mkdir(base + "/tuesday")
            for seed, path in enumerate(("survey.las", "monday/1.las", "monday/2.las", "tuesday/3.las")):
                e2e.run([e2e.SYNTH, "--points", "3000", "--seed", str(seed + 1), os.path.join(base, path)]).ok()
            with Daemon(base, memory="64M") as d:
                env = dict(os.environ, ACUT_SOCKET=d.socket, PATH=":".join(
                    [os.path.dirname(os.path.abspath(p)) for p in (ACUTCTL, e2e.SYNTH)] + [os.environ["PATH"]]))
                if "verify" in name:
                    d.ctl("mesh", base + "/survey.las", "-o", base + "/survey.ply").ok()
                    low = d.ctl("info", base + "/survey.las", "--json").ok().json()["min"]
                    with open(base + "/roads.csv", "w") as f:
                        f.write("x,y,z,name\n" + "".join("%r,%r,%r,a\n" % (low[0] + 5 * i, low[1] + 4 + i % 2, low[2]) for i in range(1, 5)))
                    d.ctl("mesh", base + "/survey.las", "--breaklines", base + "/roads.csv", "--assume-crs", "EPSG:32633", "--assume-units", "m,m", "-o", base + "/roads.ply").ok()
                for line in lines:
                    if "--replace" in line:
                        e2e.run([e2e.SYNTH, "--points", "2500", "--seed", "9", base + "/tuesday/3.las"]).ok()
                    if "| jq" in line and not shutil.which("jq"):
                        line = line.split("|")[0]
                    p = subprocess.run(["bash", "-o", "pipefail", "-c", line.replace("\\\\", "\\")], cwd=base, env=env, stdin=subprocess.DEVNULL,
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
                    expect(p.returncode == 0, "%s: %s\nended with %d\n%s%s" % (name, line, p.returncode, p.stdout.decode(), p.stderr.decode()))


def products_are_made():
    """The commands of acut-outputs(7), to the letter; "fetch 4" is of the job that there is."""
    with Folder() as base, Daemon(base, memory="64M") as d:
        os.mkdir(base + "/tiles")
        for seed in (1, 2):
            e2e.run([e2e.SYNTH, "--points", "3000", "--seed", str(seed), "%s/tiles/%d.las" % (base, seed)]).ok()
        d.ctl("push", "valley", base + "/tiles").ok()
        job = str(d.ctl("submit", "valley", "--wait", "--json").ok().json()["job"])
        blocks = re.findall(r"^```\n(.*?)^```", text_of("acut-outputs.7.scd"), re.M | re.S)
        expect(len(blocks) == 6, "%d sections with commands" % len(blocks))
        for line in "".join(blocks).splitlines():
            words = [job if w == "4" else base + "/" + w if w == "tiles/" or before == "-o" else w
                     for before, w in zip([""] + line.split(), line.split())][1:]
            outs = [w for before, w in zip(words, words[1:]) if before == "-o"]
            for out in outs:
                shutil.rmtree(out, ignore_errors=True)
            d.ctl(*words).ok()
            expect(outs and all(os.path.exists(out) for out in outs), line)


def protocol_example_runs():
    if not shutil.which("protoc"):
        e2e.unavailable("protoc is not installed")
    code = re.search(r"^```\n(.*?)^```", text_of("acut-protocol.7.scd"), re.M | re.S).group(1)
    with Folder() as base:
        subprocess.run(["protoc", "--python_out=" + base, "-I" + SOURCE + "/proto", "acut.proto"], check=True, timeout=e2e.PATIENCE)
        with Daemon(base, memory="64M") as d:
            expect("/run/acut/acutd.sock" in code, "the example has another socket")
            with open(base + "/ping.py", "w") as f:
                f.write(code.replace("/run/acut/acutd.sock", d.socket))
            got = e2e.run([sys.executable, base + "/ping.py"], timeout=e2e.PATIENCE).ok().out.split()
            expect(len(got) == 2 and got[1] == "done", "%s" % got)


e2e.main(groff_is_silent, all_pages_are_known, statuses_and_environment, verbs, examples_run, products_are_made, protocol_example_runs)
