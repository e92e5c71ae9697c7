"""acut-scan's command line: what is understood, what is refused and how; help, the man page and completion agree both ways."""
import json
import os
import re
import shutil
import subprocess

import scan
from scan import PROFILES, SCAN, SOURCE, Folder, expect, run

COMMANDS = re.findall(r"^  acut-scan (\S+)", run("help").out, re.M)


def options_of(command):
    lines = [line for line in run("help", command).out.splitlines() if line.startswith("  ") and not line.startswith("  acut-scan")]
    return set(re.findall(r"^  (?:-\w, )?--([a-z-]+)", "\n".join(lines), re.M))


def refused():
    for args, status, text in ((([]), 2, "no command"), (["lst"], 2, "did you mean acut-scan list"), (["record"], 2, "has no output"),
                               (["record", "-o", "x", "--folder", "."], 2, "both"), (["record", "-o", "-"], 2, "standard output"),
                               (["record", "-o", "x", "--for", "soon"], 2, "not a time"), (["record", "-o", "x", "--for", "0"], 2, "not a time"),
                               (["record", "-o", "x", "--bytes", "12Q"], 2, "not a size"), (["record", "-o", "x", "-o", "y"], 2, "twice"),
                               (["record", "-o", "x", "--from", "a", "serial:1"], 2, "no device"),
                               (["record", "-o", "x", "--from", "a", "--reconnect"], 2, "--reconnect"),
                               (["record", "-o"], 2, "needs a value"), (["record", "a", "b", "-o", "x"], 2, 'no word "b"'),
                               (["list", "--reconnect"], 2, "takes no --reconnect"), (["list", "--al"], 2, "did you mean --all"),
                               (["record", "--from", "/nonexistent", "-o", "x"], 74, "/nonexistent"),
                               (["record", "--from", "/dev/null", "--profile", "sik-tim", "-o", "x"], 2, "sick-tim"),
                               (["record", "--from", "/dev/null", "--profile", "./none.conf", "-o", "x"], None, "none.conf")):
        more = ["--profiles", PROFILES] if args and args[0] in ("record", "list") and args[-1] != "-o" else []
        got = run(*args, *more)
        expect((got.status == status or status is None and got.status) and text in got.err, "%s: %d %s" % (args, got.status, got.err))
        expect(not got.out, got.out)
        expect(not os.path.exists("x"), "%s left a file" % args)
        if not args or args[-1] == "-o":
            continue
        got = run(*args, *more, "--json")
        said = got.err if "-" in args else got.out  # where "-" is the output
        error = json.loads(said)["error"]
        expect(set(error) == {"code", "file", "offset", "field", "message", "hint"}, said)


def without_profiles():
    """Where acut is not installed: what names the folder that it lacks is said."""
    got = run("record", "--from", "/dev/null", "--profile", "sick-tim", "-o", "x")
    if got.status == 0:
        os.unlink("x")
        return
    expect(got.status == 2 and "there is no profile in /" in got.err and "--profiles DIR" in got.err, "%d %s" % (got.status, got.err))
    got = run("record", "--from", "/dev/null", "--profile", os.path.join(PROFILES, "sick-tim.conf"), "-o", "x").ok()
    os.unlink("x")
    expect("--profiles" not in got.err, got.err)


def help_and_page():
    with open(os.path.join(SOURCE, "man/acut-scan.1.scd")) as f:
        page = f.read()
    known = set()
    for c in COMMANDS:
        got = run("help", c).ok()
        expect(c == "help" or run(c, "--help").out == got.out, "%s --help is not help %s" % (c, c))
        expect(re.search(r"^\*%s\*" % c, page, re.M), "the man page has no %s" % c)
        expect("examples:" in got.out, "help %s has no example" % c)
        known |= options_of(c)
        statuses = set(re.findall(r"(?<![\w.])(\d+) [a-z]", got.out.split("exit status:")[1]))
        said = set(re.findall(r"\*(\d+)\*", page.split("# EXIT STATUS")[1].split("# EXAMPLES")[0]))
        expect(statuses | {"130", "143", "129", "141"} == said, "statuses %s, page %s" % (statuses, said))
    options = page.split("# OPTIONS")[1].split("# JSON")[0]
    said = set(re.findall(r"\*--([a-z-]+)\*", "\n".join(line for line in options.splitlines() if line.startswith("*"))))
    expect(known == said, "help has %s, the page has %s" % (known - said, said - known))
    expect(run("version").out.startswith("acut-scan ") and json.loads(run("version", "--json").out)["version"], "version")


def examples_are_command_lines():
    for c in COMMANDS:
        for line in re.findall(r"^  acut-scan (.*)$", run("help", c).out.split("examples:")[1], re.M):
            expect(run(*line.split(), "--help").status == 0, line)


def names_in_json():
    """Each key of what record says is in the page."""
    with open(os.path.join(SOURCE, "man/acut-scan.1.scd")) as f:
        page = f.read().split("# JSON")[1].split("# EXIT")[0]
    said = set(re.findall(r"\*([a-z_0-9]+)\*", page))
    with Folder() as d:
        out = run("record", "--from", "-", "-o", d("a"), "--json", given=b"x").ok().out
    for line in out.splitlines():
        expect(set(json.loads(line)) <= said, "not in the page: %s" % (set(json.loads(line)) - said))


def complete(*words):
    got = subprocess.run([SCAN, "complete", str(len(words)), "acut-scan", *words], stdout=subprocess.PIPE, timeout=180)
    return [line.split("\t")[0] for line in got.stdout.decode().splitlines()]


def completion():
    expect(sorted(complete("")) == sorted(COMMANDS), complete(""))
    expect(complete("rec") == ["record"], "")
    for c in COMMANDS:
        expect({"--" + o for o in options_of(c)} == set(complete(c, "--")), c)
    expect(complete("record", "--folder", "") == [":folders"] and complete("record", "-o", "") == [":files"], "")
    expect(complete("replay", "") == [":files .spool"], complete("replay", ""))
    expect(complete("push", "a.spool", "--pose-clock", "") == ["utc", "gps"], "")
    expect(complete("push", "--pose-clock=g") == ["gps"], "")
    expect(complete("help", "li") == ["list"], "")
    for n in ("0", "x", "9"):
        expect(subprocess.run([SCAN, "complete", n, "acut-scan"], stdout=subprocess.PIPE, timeout=180).returncode == 2, n)


def shells():
    folder = os.path.dirname(os.path.abspath(SCAN))
    env = dict(os.environ, PATH=os.path.dirname(os.path.abspath(SCAN)) + ":" + os.environ["PATH"])
    script = ("source %s/acut-scan.bash\nCOMP_WORDS=(acut-scan record --rec)\nCOMP_CWORD=2\n_acut_scan\n"
              "printf '%%s\\n' \"${COMPREPLY[@]}\"" % folder)
    got = subprocess.run(["bash", "--norc", "-c", script], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=180)
    expect(got.stdout == b"--reconnect\n" and not got.stderr, "%s %s" % (got.stdout, got.stderr))
    if shutil.which("zsh"):
        got = subprocess.run(["zsh", "-fn", folder + "/_acut-scan"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=180)
        expect(got.returncode == 0, got.stdout.decode())


scan.main(refused, without_profiles, help_and_page, examples_are_command_lines, names_in_json, completion, shells)
