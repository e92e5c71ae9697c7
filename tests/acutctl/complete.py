"""Completion in real shells: what bash and zsh would show for a line, with and without a daemon, and how long it takes."""
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import Daemon, Fault, Folder, expect  # noqa: E402

SOURCE = os.environ["ACUT_COMPLETION"]
ACUTCTL = os.path.abspath(e2e.ACUTCTL)
BASH_COMPLETION = "/usr/share/bash-completion/bash_completion"


def environment(base, socket=None):
    env = {k: v for k, v in os.environ.items() if not k.startswith(("ACUT_", "XDG_"))}
    env.update(HOME=base, XDG_RUNTIME_DIR=base, PATH=os.path.dirname(ACUTCTL) + ":" + env["PATH"], TERM="dumb",
               ASAN_OPTIONS="detect_leaks=0", ACUT_COMPLETE_SECONDS=str(e2e.PATIENCE))
    if socket:
        env["ACUT_SOCKET"] = socket
    return env


def bash(words, env, cwd, helpers=True):
    """COMPREPLY for a line of these words, the last one being typed."""
    script = ("%s\nsource %s/acutctl.bash\nCOMP_WORDS=(\"$@\")\nCOMP_CWORD=$(($# - 1))\nCOMP_LINE=\"$*\"\nCOMP_POINT=${#COMP_LINE}\n"
              "cur=\"${COMP_WORDS[COMP_CWORD]}\"\n_acutctl\nprintf '%%s\\n' \"${COMPREPLY[@]}\"\n") % (
                  "source " + BASH_COMPLETION if helpers else "", SOURCE)
    p = subprocess.run(["bash", "--norc", "-c", script, "bash", *words], env=env, cwd=cwd, stdout=subprocess.PIPE,
                       stderr=subprocess.PIPE, timeout=e2e.PATIENCE)
    noise = [line for line in p.stderr.decode().splitlines() if "compopt: not currently executing" not in line]
    expect(not noise, "%s: %s" % (words, noise))
    return [line for line in p.stdout.decode().splitlines() if line]


def contains(got, wanted, without=()):
    expect(set(wanted) <= set(got) and not set(without) & set(got), "%s: not %s, or one of %s" % (got, wanted, without))


def words_of_the_tables():
    with Folder() as base:
        env = environment(base)
        ask = lambda *words: bash(["acutctl", *words], env, base)
        commands = ask("")
        contains(commands, ["mesh", "push", "dataset", "datasets", "status"], ["complete"])
        listed = re.findall(r"^  acutctl (\S+)", e2e.run([ACUTCTL, "help"]).out, re.M)
        expect(sorted(commands) == sorted(set(listed)), "%s, help: %s" % (commands, listed))
        expect(ask("da") == ["dataset", "datasets"], ask("da"))
        contains(ask("dataset", ""), ["show", "log", "revert", "restore"])
        expect(ask("dataset", "show", "x", "--a") == ["--at"], ask("dataset", "show", "x", "--a"))
        expect(ask("mesh", "a.las", "--returns", "") == ["all", "first", "last"], ask("mesh", "a.las", "--returns", ""))
        expect(ask("mesh", "--duplicates", "") == ["highest", "lowest"] or ask("mesh", "--duplicates", "") == ["lowest", "highest"], "")
        expect(ask("mesh", "--duplicates", "=", "h") == ["highest"], ask("mesh", "--duplicates", "=", "h"))
        contains(ask("mesh", "--format", ""), ["ply", "obj", "landxml", "dxf", "glb", "stl", "html", "png", "null"])
        contains(ask("info", "--input-format", ""), ["las", "ptx", "lines", "xyz", "pts"])
        contains(ask("help", ""), ["mesh", "push"], ["complete"])
        contains(ask("help", "dataset", ""), ["export", "log", "revert"], ["mesh", "dataset"])
        contains(ask("help", "dataset", "re"), ["revert", "restore"], ["log"])
        for words in (("help", "mesh", ""), ("help", "dataset", "log", ""), ("help", "no-such", "")):
            expect(not ask(*words), "%s: %s" % (words, ask(*words)))
        expect(ask("nonsense", "") == [] and ask("jobs", "") == [], "words where there are none")
        expect(ask("push", "valley", "--", "--fo") == [], "an option behind --")
        # Every option of every command, and no other.
        for command in commands:
            listed = set(re.findall(r"--[a-z-]+", "\n".join(
                line[:28] for line in e2e.run([ACUTCTL, "help", command]).out.splitlines() if line.startswith("  -"))))
            if not any(line.startswith("  acutctl " + command + " ") for line in e2e.run([ACUTCTL, "help", command]).out.splitlines()[1:4]):
                got = set(ask(command, "-"))
                expect(got == listed, "%s: %s" % (command, got ^ listed))


def files_of_a_kind():
    with Folder() as base:
        env = environment(base)
        for name in ("a.las", "b.LAZ", "c.txt", "notes.md", "egm.pgm", "with blank.xyz"):
            open(os.path.join(base, name), "w").close()
        os.mkdir(os.path.join(base, "monday"))
        ask = lambda *words, **kw: bash(["acutctl", *words], env, base, **kw)
        contains(ask("mesh", ""), ["a.las", "b.LAZ", "c.txt", "monday", "with blank.xyz"], ["notes.md", "egm.pgm"])
        contains(ask("geoid", "add", ""), ["egm.pgm"], ["a.las"])
        contains(ask("mesh", "a.las", "--cache", ""), ["monday"], ["a.las"])
        contains(ask("mesh", "a.las", "-o", ""), ["a.las", "notes.md"])
        contains(ask("mesh", "a", helpers=False), ["a.las"])


def names_of_the_daemon():
    with Folder() as base:
        survey = os.path.join(base, "s.xyz")
        with open(survey, "w") as f:
            f.write("0 0 1\n1 0 2\n0 1 3\n5 5 5\n")
        with Daemon(base, memory="64M") as d:
            env = environment(base, d.socket)
            for name in ("valley", "valdez", "other"):
                d.ctl("push", name, survey).ok()
            with open(survey, "a") as f:
                f.write("9 9 9\n")
            d.ctl("push", "valley", survey, "--replace").ok()
            for name in ("valley", "other"):
                d.ctl("submit", name, "--wait").ok()
            d.ctl("dataset", "rm", "other").ok()
            ask = lambda *words: bash(["acutctl", *words], env, base)
            expect(sorted(ask("submit", "val")) == ["valdez", "valley"], ask("submit", "val"))
            expect(ask("dataset", "restore", "") == ["other"], ask("dataset", "restore", ""))
            expect(sorted(ask("fetch", "")) == ["1", "2"] and ask("cancel", "") == [], "jobs: %s" % ask("fetch", ""))
            expect(sorted(ask("wait", "1", "")) == ["1", "2"], ask("wait", "1", ""))
            expect(sorted(ask("submit", "valley", "--at", "")) == ["1", "2"], ask("submit", "valley", "--at", ""))
            expect(sorted(ask("fetch", "1", "--changed-since", "")) == ["1", "2"], ask("fetch", "1", "--changed-since", ""))
            expect(sorted(ask("dataset", "revert", "valley", "")) == ["1", "2"], ask("dataset", "revert", "valley", ""))
            # Completion asks the daemon of the --socket on the command line.
            none = environment(base)
            got = bash(["acutctl", "submit", "--socket", d.socket, "val"], none, base)
            expect(sorted(got) == ["valdez", "valley"], got)
            # It waits a second for a daemon that does not answer.
            del env["ACUT_COMPLETE_SECONDS"]
            os.kill(d.process.pid, signal.SIGSTOP)
            got = ask("submit", "val")
            os.kill(d.process.pid, signal.SIGCONT)
            expect(got == [], "%s, of a stopped daemon" % got)


def without_a_daemon():
    with Folder() as base:
        env = environment(base)
        expect(bash(["acutctl", "submit", ""], env, base) == [], "datasets without a daemon")
        expect(bash(["acutctl", "submit", "--private", ""], env, base) == [], "datasets without a private daemon")
        p = subprocess.run(["pgrep", "-f", base], stdout=subprocess.PIPE)
        expect(not p.stdout, "a daemon was started")
        p = subprocess.run([ACUTCTL, "complete", "2", "acutctl", "submit", ""], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        expect((p.returncode, p.stdout, p.stderr) == (0, b"", b""), "%s" % p)


def in_zsh():
    """A real zsh on a terminal: a line is typed, Tab is pressed twice, and the resulting line is printed."""
    if not shutil.which("zsh"):
        e2e.unavailable("zsh is not installed")
    with Folder() as base:
        env = environment(base)
        env.update(TERM="xterm", ZDOTDIR=base, PS1="> ")
        open(os.path.join(base, "survey.las"), "w").close()
        open(os.path.join(base, "survey.md"), "w").close()
        with open(os.path.join(base, ".zshrc"), "w") as f:
            f.write("fpath=(%s $fpath)\nautoload -U compinit\ncompinit -u -D\nzstyle ':completion:*' verbose yes\n"
                    "bindkey '^I' complete-word\nshow() { BUFFER=\"print -r -- LINE:${(q)BUFFER}:END\"; zle accept-line }\n"
                    "zle -N show\nbindkey '^X' show\nPS1='READY '\n" % SOURCE)
        child, terminal = pty.fork()
        if not child:
            os.chdir(base)
            os.execvpe("zsh", ["zsh", "-i"], env)
        os.set_blocking(terminal, False)

        def until(wanted):
            seen, end = "", time.monotonic() + e2e.PATIENCE
            while time.monotonic() < end:
                if select.select([terminal], [], [], 0.1)[0]:
                    try:
                        seen += os.read(terminal, 65536).decode(errors="replace")
                    except OSError:
                        break
                found = re.search(wanted, seen)
                if found:
                    return found, seen
            raise Fault("zsh showed no %s: %r" % (wanted, seen[-2000:]))

        try:
            until("READY ")
            for typed, wanted in (("acutctl dataset sh\t", "acutctl dataset show "), ("acutctl mesh sur\t", "acutctl mesh survey.las "),
                                  ("acutctl mesh x --returns fi\t", "acutctl mesh x --returns first "),
                                  ("acutctl mesh x --returns=la\t", "acutctl mesh x --returns=last "),
                                  ("acutctl mesh x --accept\t", "acutctl mesh x --accept-truncated ")):
                os.write(terminal, typed.encode() + b"\x18")
                found, _ = until(r"LINE:(.*?):END\r")
                got = found.group(1).replace("\\", "").rstrip()
                expect(got == wanted.rstrip(), "%r became %r" % (typed, got))
            os.write(terminal, b"acutctl mesh x --format=\t")
            until(r"binary little-endian PLY")
        finally:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            os.close(terminal)


if not shutil.which("bash"):
    e2e.unavailable("bash is not installed")
e2e.main(words_of_the_tables, files_of_a_kind, names_of_the_daemon, without_a_daemon, in_zsh)
