"""The scripts of etc/examples/scanner, with stand-ins for acut-scan and mount: no spool is left out or pushed twice."""
import os
import subprocess
import sys

from e2e import Folder, expect, main

SCRIPTS = sys.argv[1]


def stand_in(base, name, text):
    os.makedirs(base + "/bin", exist_ok=True)
    with open(base + "/bin/" + name, "w") as f:
        f.write("#!/bin/sh\n" + text)
    os.chmod(base + "/bin/" + name, 0o755)


def run(base, script, *args, **env):
    env = dict(os.environ, PATH=base + "/bin:" + os.environ["PATH"], **env)
    return subprocess.run(["sh", os.path.join(SCRIPTS, script), *args], env=env, cwd=base, capture_output=True, text=True, timeout=180)


def write(path, text, age=3600):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w") as f:
        f.write(text)
    when = os.stat(path).st_mtime - age
    os.utime(path, (when, when))


def spools():
    with Folder() as base:
        stand_in(base, "acut-scan", 'echo "$@" >>"$LOG"\nexit "${STATUS:-0}"\n')
        log = base + "/log"

        def calls(**env):
            open(log, "w").close()
            r = run(base, "push-spools.sh", "spools", "poses", "d", "--replace", LOG=log, **env)
            return r.returncode, [line.split()[1] for line in open(log)]

        write(base + "/spools/a.spool", "a")
        write(base + "/spools/b.spool", "b")
        write(base + "/spools/new.spool", "n", 0)
        write(base + "/poses/a.csv", "p")
        write(base + "/poses/new.csv", "p")
        expect(calls(STATUS="69") == (69, ["spools/a.spool"]), "a daemon that is away")
        expect(calls() == (0, ["spools/a.spool"]), "the first time")
        expect(calls() == (0, []), "the second time")
        expect(calls(SETTLE_MINUTES="0") == (0, ["spools/new.spool"]), "one that was written to")
        write(base + "/poses/b.csv", "p")
        expect(calls() == (0, ["spools/b.spool"]), "poses came")
        # grown, and corrected: dated behind the mark
        write(base + "/spools/a.spool", "aa", -60)
        expect(calls(SETTLE_MINUTES="-9") == (0, ["spools/a.spool"]), "a spool that has grown")
        write(base + "/spools/a.spool", "aa")
        write(base + "/poses/b.csv", "q", -60)
        expect(calls(STATUS="1") == (1, ["spools/b.spool"]), "poses that are refused")
        expect(calls()[1] == ["spools/b.spool"], "again, since it was refused")


def storage():
    with Folder() as base:
        stand_in(base, "mount", "exit 0\n")
        disk, drop = base + "/disk", base + "/drop"

        def copied():
            r = run(base, "copy-storage.sh", "/dev/null", drop, MOUNT_POINT=disk)
            expect(r.returncode == 0, r.stderr)
            return len(r.stdout.splitlines())

        os.mkdir(drop)
        os.mkdir(drop + "/done")
        write(disk + "/day/scan 001.las", "monday")
        write(disk + "/x.txt", "none")
        expect(copied() == 1 and open(drop + "/day_scan 001.las").read() == "monday", "the first disk")
        os.rename(drop + "/day_scan 001.las", drop + "/done/day_scan 001.las")
        expect(copied() == 0, "the same disk again")
        write(disk + "/day/scan 001.las", "tuesday")
        expect(copied() == 1, "another file of the same name was left out")
        name, = [n for n in os.listdir(drop) if n != "done"]
        expect(name.startswith("day_scan 001-") and name.endswith(".las") and open(drop + "/" + name).read() == "tuesday", name)
        expect(copied() == 0, "the second disk again")


if __name__ == "__main__":
    main(spools, storage)
