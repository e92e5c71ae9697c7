"""acut-cluster and acut-task without a cluster: what is refused and how, help and man pages, settings, completion."""
import json
import os
import re
import shutil
import subprocess
import tempfile

from checks import asked, check, end

CLUSTER, TASK, SOURCE = os.environ["ACUT_CLUSTER"], os.environ["ACUT_TASK_PROGRAM"], os.environ["ACUT_SOURCE"]


def run(*args, program=CLUSTER, cwd=None):
    p = subprocess.run([program, *args], capture_output=True, text=True, cwd=cwd, timeout=240, env={**os.environ, "PATH": "/nowhere"})
    return p.returncode, p.stdout, p.stderr


def expect(args, status, *texts, **kw):
    got, out, err = run(*args, **kw)
    check(" ".join(args), got == status and all(t in out + err for t in texts), "\n  status %d, wanted %d %s\n  %s%s" % (got, status, texts, out, err))
    return out


def page(name):
    with open(os.path.join(SOURCE, "man", name)) as f:
        return f.read()


COMMANDS = re.findall(r"^  acut-cluster (\S+)", run("help")[1], re.M)


def options_of(command):
    return set(re.findall(r"--([a-z][a-z-]*)", "\n".join(l[:26] for l in run("help", command)[1].splitlines() if l.startswith("  ")
                                                         and not l.startswith("  acut"))))


def refusals(base):
    survey, work, out = base + "/a.xyz", base + "/w", base + "/m.ply"
    with open(survey, "w") as f:
        f.write("0 0 0\n1 0 0\n0 1 0\n")
    new = ["--work", work, "--on", "local", "--no-config"]
    expect([], 2, "no command")
    expect(["mehs"], 2, "did you mean acut-cluster mesh")
    expect(["mesh", "-o", out, *new], 2, "mesh needs at least 1 word")
    expect(["mesh", survey, *new], 2, "no output")
    expect(["mesh", survey, "-o", out, "--work", work, "--no-config"], 2, "it is not said where the tasks run", "--on slurm, local or script")
    expect(["mesh", survey, "-o", out, "--on", "local", "--no-config"], 2, "no work folder")
    expect(["mesh", survey, "-o", out, "--work", work, "--on", "slrum"], 2, "did you mean slurm")
    expect(["mesh", survey, "-o", out, *new, "--script", "x"], 2, "--script is for --on script")
    expect(["mesh", survey, "-o", out, *new[:2], "--on", "slurm", "--no-config"], 69, "there is no program sbatch here", "--on local")
    expect(["mesh", survey, "-o", out, "--work", base + "/a\\b", "--on", "slurm", "--no-config"], 2, "a backslash in its path")
    expect(["mesh", survey, "-o", out, "--work", base + "/a\nb", "--on", "script", "--no-config"], 2, "no line feed")
    expect(["mesh", survey, "-o", "-", *new], 2, "standard output is no output of a cluster")
    expect(["mesh", survey, "-o", survey, *new], 2, "one of the inputs")
    expect(["mesh", survey, "-o", base + "/m.foo", *new], 2, "does not give a format")
    for name, words in (("/m.ply", []), ("/../w/m.ply", []), ("/", ["--tile", "100"]), ("/out", ["--tile", "100"])):
        expect(["mesh", survey, "-o", work + name, *words, *new], 2, "the output is in the work folder", work + name)
    os.mkdir(work)
    os.symlink("w", base + "/link")
    for name in (work + "/m.ply", base + "/link/m.ply", "w/m.ply", "link/../w/m.ply"):
        expect(["mesh", survey, "-o", name, *new], 2, "the output is in the work folder", cwd=base)
    expect(["mesh", survey, "-o", "m.ply", "--work", "."], 2, "the output is in the work folder", cwd=work)
    os.unlink(base + "/link")
    os.rmdir(work)
    expect(["mesh", "-", "-o", out, "--input-format", "xyz", *new], 2, "a pipe is no input of a cluster")
    expect(["mesh", base + "/none.laz", "-o", out, *new], 1, "none.laz", "cannot be opened")
    os.mkfifo(base + "/fifo.xyz")
    with open(base + "/list", "w") as f:
        f.write(base + "/fifo.xyz\n")
    for word in ("/fifo.xyz", "/list"):
        expect(["mesh", ("@" if word == "/list" else "") + base + word, "-o", out, *new], 2, "fifo.xyz", "a pipe is no input of a cluster")
    expect(["mesh", "/dev/null", "-o", out, *new], 1, "/dev/null", "it is no regular file")
    for name in ("/fifo.xyz", "/list"):
        os.unlink(base + name)
    expect(["mesh", survey, "-o", out, "--task-memory", "1M", *new], 1, "a task needs at least", "--task-memory")
    expect(["mesh", survey, "-o", out, "--input-format", "xzy", *new], 2, "there is no input format xzy")
    expect(["mesh", survey, "-o", out, "--attempts", "101", *new], 2, "--attempts is at most 100")
    expect(["mesh", survey, "-o", out, "--max-tasks", "4294967296", *new], 2, "--max-tasks is at most 1000000")
    expect(["mesh", survey, "-o", out, "--task-seconds", "soon", *new], 2, "not a time")
    expect(["mesh", survey, "-o", out, "--directory", base + "/none", *new], 74, base + "/none")
    expect(["mesh", survey, "-o", out, "--config", base + "/none", *new[:-1]], 2, "make it, or leave --config out")
    for option, value in (("crop", "0,0,1,1"), ("bbox", "0,0,1,1"), ("thin", "5"), ("every", "2"), ("max-error", "0.1"), ("weight", "2=1"),
                          ("metric", "3,1,20"), ("polygon", survey)):
        expect(["mesh", survey, "-o", out, "--" + option, value, *new], 2, "a run of a cluster makes no mesh with --" + option, "import")
    expect(["mesh", survey, "-o", out, "--class", "300", *new], 2, "not a list of classes")
    expect(["stage", survey, "-o", out, *new], 2, "stage takes no --output")
    for command in ("show", "wait", "cancel", "resume", "clean"):
        expect([command], 2, "needs at least 1 word")
        expect([command, base], 4, "it is no work folder")
        expect([command, base + "/nix"], 4, "there is no such folder")
    error = json.loads(expect(["show", base, "--json"], 4))["error"]
    check("an error as JSON", error["code"] == "not-found" and error["file"] == base, str(error))
    with open(base + "/full", "w"):
        pass
    expect(["stage", survey, "--work", base, "--on", "local", "--no-config"], 1, "the folder is not empty")
    check("nothing is left", sorted(os.listdir(base)) == ["a.xyz", "full"], str(os.listdir(base)))
    for args, status, text in (([], 2, "three words are wanted"), ([base, "stage"], 2, "three words"), ([base, "stagee", "0"], 2, "no phase"),
                               ([base, "stage", "-1"], 2, "not the number"), ([base, "stage", "0"], 4, "no work folder"),
                               (["--help"], 0, "usage: acut-task WORK PHASE INDEX"), (["--version"], 0, "acut-task ")):
        expect(args, status, text, program=TASK)


def owners(base):
    """A run of another user is shown, cancelled and cleaned, and not submitted."""
    survey, work = base + "/a.xyz", base + "/w"
    with open(survey, "w") as f:
        f.write("0 0 0\n1 0 0\n0 1 0\n")
    expect(["stage", survey, "--work", work, "--on", "script", "--no-config"], 0)
    if os.geteuid():
        print("     owners: only root can give a file away")
        return
    os.chown(work + "/acut-work", 4321, -1)
    for command in ("wait", "resume"):
        expect([command, work], 77, "belongs to the user 4321")
    expect(["show", work], 0)
    expect(["cancel", work], 0)
    expect(["clean", work, "--force"], 0)


def scripts(base):
    """A script takes the place of another one, and of nothing else."""
    survey, work, script = base + "/a.xyz", base + "/w", base + "/s"
    points = "0 0 0\n1 0 0\n0 1 0\n"
    with open(survey, "w") as f:
        f.write(points)
    new = ["stage", survey, "--work", work, "--on", "script", "--no-config", "--script"]
    expect([*new, survey], 1, "it is no script of acut-cluster", "a.xyz")
    expect([*new, "/dev/null"], 1, "it is no script of acut-cluster")
    with open(survey) as f:
        check("the input is whole", f.read() == points and not os.path.exists(work))
    expect([*new, script], 0)
    with open(script) as f:
        text = f.read()
    expect(["resume", work, "--script", survey], 1, "it is no script of acut-cluster")
    with open(script, "a") as f:
        f.write("more\n")
    expect(["resume", work, "--script", script], 0)
    with open(script) as f:
        check("written again", f.read() == text and os.access(script, os.X_OK))
    # The recipe of the page, with a parallel of our own: all commands in their order.
    recipe = page("acut-cluster.1.scd").split("For GNU parallel:")[1].split("```")[1]
    os.mkdir(base + "/recipe")
    with open(base + "/recipe/parallel", "w") as f:
        f.write("#!/bin/sh\ncat >>ran\n")
    os.chmod(f.name, 0o755)
    with open(base + "/recipe/script", "w") as f:
        f.write("".join("# phase p%d: 1 tasks\n'task' %d\n" % (k, k) for k in range(12)))
    subprocess.run(["sh", "-e", "-c", recipe], cwd=base + "/recipe", env={**os.environ, "PATH": base + "/recipe:" + os.environ["PATH"]}, check=True)
    with open(base + "/recipe/ran") as f:
        check("the recipe", f.read() == "".join("'task' %d\n" % k for k in range(12)))
    shutil.rmtree(base + "/recipe")
    check("nothing else is left", sorted(os.listdir(base)) == ["a.xyz", "s", "w"], str(os.listdir(base)))


def settings(base):
    conf, survey = base + "/cluster.conf", base + "/a.xyz"

    def with_settings(text, *args, status=0, says=""):
        with open(conf, "w") as f:
            f.write(text)
        return expect(["plan", survey, "--config", conf, *args], status, says)

    with open(survey, "w") as f:
        f.write("0 0 0\n" * 100000)
    for text, says in (("schedulr = slurm", "is scheduler meant?"), ("scheduler = pbs", "slurm, local or script is wanted"),
                       ("time = soon", "a time above 0"), ("task-memory = 0", "a size as 2G"), ("max-tasks = -1", "a number above 0"),
                       ("attempts = x", "a number above 0"), ("[slurm]", "no sections"), ("partition", 'no "=" in'),
                       ("\n\nqos = a # b", "cluster.conf:3"), ("x = 1", "cluster.conf(5) lists the settings")):
        with_settings(text + "\n", status=2, says=says)

    def tasks(text, *args):
        return {p["phase"]: (p["tasks"], p["memory"] >> 20) for p in json.loads(with_settings(text, *args, "--json"))["phases"]}

    check("presets", tasks("")["mesh"] == (1, 1024 + 64), str(tasks("")))
    check("task-memory", tasks("task-memory = 2G\n")["mesh"][1] == 2048 + 64)
    check("an option comes first", tasks("task-memory = 2G\n", "--task-memory", "512M")["mesh"][1] == 512 + 64)
    check("task-seconds", tasks("task-seconds = 0.001s\n")["mesh"][0] > 5, str(tasks("task-seconds = 0.001s\n")))
    check("task-points are not overridden", tasks("task-seconds = 0.001s\n", "--task-points", "1000000")["mesh"][0] == 1)
    check("task-points in thousands and millions", [tasks("", "--task-points", n)["mesh"] for n in ("1k", "1000")] == [tasks("", "--task-points", "1000")["mesh"]] * 2
          and tasks("", "--task-points", "0.001k")["mesh"][0] == tasks("", "--task-points", "1")["mesh"][0] > 1)
    os.mkdir(conf + ".d")
    with open(conf + ".d/10-site.conf", "w") as f:
        f.write("task-memory = 3G\n")
    check("the folder beside it", tasks("task-memory = 2G\n")["mesh"][1] == 3072 + 64)
    # The shipped file sets nothing, and has each setting of the page; so has the page each of the program.
    with open(os.path.join(SOURCE, "etc/cluster.conf")) as f:
        shipped = f.read()
    names = set(re.findall(r"\*([a-z-]+)\* = ", page("cluster.conf.5.scd").split("# SETTINGS")[1].split("# EXAMPLE")[0]))
    check("the shipped file and the page", set(re.findall(r"^#([a-z-]+) =", shipped, re.M)) == names, str(names))
    with_settings(shipped)
    for line in re.findall(r"^#([a-z-]+ =.*)", shipped, re.M):
        with_settings(line + "\n")


def sizes(base):
    """What is expected of phases of one task, of large inputs, and of many small ones. The files have holes."""
    def plan(*args):
        out = json.loads(expect(["plan", *args, "--no-config", "--json"], 0))
        return out, {p["phase"]: p for p in out["phases"]}

    def made(name, size):
        with open(base + "/" + name, "w") as f:
            f.truncate(size)
        return base + "/" + name

    large, text, small = made("large.laz", 130 << 30), made("a.xyz", 600 << 30), base + "/small"
    out, of = plan(large, "-o", base + "/m.obj")
    check("core-hours of all phases", all(p["core_hours"] > 0 for p in out["phases"]), str(out))
    check("core-hours are the sum", abs(out["core_hours"] - sum(p["core_hours"] for p in out["phases"])) < 1e-6, str(out))
    check("time of a file that one task gathers", of["gather"]["time"] > 3 * 3600 and of["mesh"]["time"] == of["finish"]["time"] == 3600, str(of))
    check("time of a large input", of["stage"]["time"] > 3 * 3600, str(of["stage"]))
    check("time of a text that the head reads", plan(text, "--format", "null")[1]["head"]["time"] > 3 * 3600)
    check("--time", {p["time"] for p in plan(large, "-o", base + "/m.obj", "--time", "90m")[0]["phases"]} == {5400})
    check("--task-seconds", plan(large, "-o", base + "/m.obj", "--task-seconds", "900")[1]["mesh"]["time"] == 9000)
    os.mkdir(small)
    for k in range(500):
        with open("%s/%d.xyz" % (small, k), "w") as f:
            f.write("1 2 3\n4 5 6\n")
    out, of = plan(small)
    check("small files", out["points"] > 200, str(out))
    check("memory of the commit", of["commit"]["memory"] == of["head"]["memory"])
    with open(base + "/many", "w") as f:
        f.writelines(small + "/1.xyz\n" for _ in range(120000))
    of = plan("@" + base + "/many", "--task-memory", "200M")[1]
    check("memory of the commit of many inputs", of["commit"]["memory"] == of["head"]["memory"] > of["plan"]["memory"], str(of))


def pages():
    text = page("acut-cluster.1.scd")
    known = set()
    for c in COMMANDS:
        out = expect(["help", c], 0, "examples:")
        check(c + " --help", c == "help" or run(c, "--help")[1] == out)
        check("the page has " + c, re.search(r"^\*%s\*" % c, text, re.M) or c in ("wait", "cancel"), "")
        known |= options_of(c)
        for line in re.findall(r"^  acut-cluster (.*)$", out.split("examples:")[1], re.M):
            check("example " + line, run(*line.split(), "--help")[0] == 0)
        statuses = set(re.findall(r"(?<![\w.])(\d+) [a-z-]", out.split("exit status:")[1])) - {"128"}
        said = set(re.findall(r"^\*(\d+)\*$", text.split("# EXIT STATUS")[1], re.M))
        check("exit statuses", statuses == said, "%s, page %s" % (statuses, said))
    own = text.split("# OPTIONS OF A RUN")[1].split("# SLURM")[0]
    said = set(re.findall(r"\*--([a-z-]+)\*", "\n".join(l for l in own.splitlines() if l.startswith("*"))))
    shared = set()
    for name in ("fetch/ctl_fetch_option.def", "view/ctl_view_option.def", "stage/ctl_stage_option.def", "input/ctl_input_option.def"):
        with open(os.path.join(SOURCE, "client", name)) as f:
            shared |= set(re.findall(r'^\w+_OPTION\("([a-z-]+)"', f.read(), re.M))
    with open(os.path.join(SOURCE, "base/view_option.def")) as f:
        shared |= set(re.findall(r'^VIEW_(?:FLAG|COUNT|HEIGHT)\(\w+, "([^"=]+)=?"', f.read(), re.M))
    shared |= {"scale", "geoid"}
    check("options and page", known - shared == said - shared, "%s" % ((known - shared) ^ (said - shared)))
    check("no shared option is missing", shared <= known, str(shared - known))


def json_names(base):
    names = set(re.findall(r"[a-z_]+", page("acut-cluster.1.scd").split("# JSON")[1].split("# ENVIRONMENT")[0]))
    survey, work = base + "/a.xyz", base + "/w"
    with open(survey, "w") as f:
        f.write("0 0 0\n1 0 0\n0 1 0\n")

    def walk(v):
        for w in v.values() if isinstance(v, dict) else v if isinstance(v, list) else ():
            yield from walk(w)
        if isinstance(v, dict):
            yield from v

    for args in (["plan", survey, "--no-config"], ["stage", survey, "--work", work, "--on", "script", "--no-config"], ["show", work], ["cancel", work],
                 ["resume", work]):
        out = json.loads(expect([*args, "--json"], 0))
        check("JSON of " + args[0], set(walk(out)) <= names, str(set(walk(out)) - names))


def completion():
    def complete(*words):
        return [l.split("\t")[0] for l in run("complete", str(len(words)), "acut-cluster", *words)[1].splitlines()]

    check("commands", sorted(complete("")) == sorted(COMMANDS), complete(""))
    for c in COMMANDS:
        check("options of " + c, {"--" + o for o in options_of(c)} == set(complete(c, "--")), set(complete(c, "--")) ^ {"--" + o for o in options_of(c)})
    check("values", complete("mesh", "--on", "") == ["slurm", "local", "script"] and complete("mesh", "--work", "") == [":folders"])
    check("words", complete("show", "") == [":folders"] and complete("mesh", "")[0].startswith(":files .las"), complete("mesh", ""))
    folder = os.path.dirname(CLUSTER)
    for shell in ("acut-cluster.bash", "_acut-cluster"):
        with open(os.path.join(folder, shell)) as f:
            check(shell, "acut-cluster complete" in f.read().replace("_acut_cluster complete", ""), "")


for part in asked(refusals, owners, scripts, settings, sizes, json_names):
    with tempfile.TemporaryDirectory() as base:
        part(base)
pages()
completion()
end()
