"""Files that other programs make from ours (client/format/format_elsewhere.c): each hint is followed to the letter, and has to give
the file that was asked for."""
import os
import re
import shlex
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e"))
import e2e  # noqa: E402
from e2e import Daemon, Folder, expect  # noqa: E402

SOURCE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "client", "format", "format_elsewhere.c")


def rows():
    """(extension, text) of the table."""
    with open(SOURCE) as f:
        found = re.findall(r'^\t\{"([. \w]+)",\s*"(.*?)"\},$', f.read(), re.M)
    expect(len(found) > 10, "the table cannot be read")
    return [(extension, text) for extensions, text in found for extension in extensions.split()]


def follow(d, base, extension, hint):
    """Writes what the hint says and runs its command. The name of the program that is not installed, or None."""
    write, command = re.fullmatch(r"write (.*?)(?:, contours)?(?:, then run: (.*)|: .*)", hint).groups()
    words = shlex.split(command or "")
    if words and not shutil.which(words[0]):
        return words[0]
    d.ctl("fetch", "1", *shlex.split(write)).ok()
    if words:
        done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        expect(done.returncode == 0, "%s: %s" % (command, done.stdout))
        made = os.path.join(base, "made" + extension)
        expect(os.path.getsize(made) > 100, "%s is empty" % made)
    return None


def hints():
    with Folder() as base, Daemon(base, memory="64M") as d:
        survey = os.path.join(base, "survey.las")
        e2e.run([e2e.SYNTH, "--points", "2000", survey]).ok()
        d.ctl("push", "s", survey).ok()
        d.ctl("submit", "s", "--wait").ok()
        without, followed = set(), 0
        for extension, text in rows():
            stem = os.path.join(base, "made")
            wanted = stem + extension
            got = d.ctl("fetch", "1", "-o", wanted)
            expect(got.status == 2 and "acutctl writes no %s files" % extension in got.err, "%s: %s" % (extension, got.err))
            hint = re.search(r"^hint: (.*)$", got.err, re.M)[1]
            expect(hint == text.replace("@", stem).replace("%", extension), "%s: %s" % (extension, hint))
            if not hint.startswith("write "):
                continue
            for old in os.listdir(base):
                if old.startswith("made."):
                    os.unlink(os.path.join(base, old))
            missing = follow(d, base, extension, hint)
            followed += not missing
            without |= {missing} - {None}
        print("%d hints followed%s" % (followed, "; not installed: " + ", ".join(sorted(without)) if without else ""))
        expect(followed > 3, "only %d hints could be followed" % followed)


e2e.main(hints)
