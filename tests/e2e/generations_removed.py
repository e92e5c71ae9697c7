"""Removed datasets: they can be restored for a time, and are deleted after it."""
import json
import os
import time

import e2e
from config import Configured
from e2e import expect
from generations import cloud, mesh, names
from survey import says, show
from acut_wire import Client, pb  # after generations.py, which skips if it is not there


def removed(d, *more):
    return [json.loads(line) for line in d.ctl("datasets", "--removed", "--json").ok().out.splitlines()]


def remove_and_restore():
    """A removed dataset frees its name, keeps its jobs and its points, and comes back as it was, over a restart too."""
    with e2e.Folder() as base:
        a, b = cloud(base, "a.las", 1, 0, 0, 500), cloud(base, "b.las", 2, 0, 0, 700)
        with e2e.Daemon(base) as d:
            d.ctl("push", "s", a).ok()
            d.ctl("push", "s", b).ok()
            first = mesh(d, "s", "--at", "1")
            job = d.ctl("submit", "s", "--wait").ok().out.split()[0]
            whole = d.ctl("show", job, "--json").ok().json()["digest"]
            for verb in ("rm", "pin", "unpin"):
                says(d.ctl("dataset", verb, "nothing"), 4, "there is no dataset", "acutctl datasets lists them")
            says(d.ctl("dataset", "pin", "s"), 0)
            says(d.ctl("dataset", "rm", "s"), 1, "pinned", "unpin")
            expect(show(d, "s")["pinned"] is True, "it is not pinned")
        with e2e.Daemon(base) as d:
            says(d.ctl("dataset", "rm", "s"), 1, "pinned")
            says(d.ctl("dataset", "unpin", "s"), 0)
            with Client(d.socket) as c:
                c.ask("push_begin", pb.PushBegin(dataset="s"))
                says(d.ctl("dataset", "rm", "s"), 75, "a push into the dataset s is open")
            e2e.until(lambda: not d.ctl("dataset", "rm", "s").status, "it cannot be removed")
            expect(names(d) == [] and [(r["name"], r["files"]) for r in removed(d)] == [("s", 2)], "%s" % removed(d))
            week = removed(d)[0]
            expect(week["removed"] < week["restorable_until"], "%s" % week)
            for words in (("dataset", "show", "s"), ("submit", "s"), ("dataset", "log", "s"), ("dataset", "revert", "s"), ("plan", "s")):
                says(d.ctl(*words), 4, "there is no dataset")
            # Its mesh can be had, and the name is free.
            says(d.ctl("fetch", job, "-o", os.path.join(base, "m.ply")), 0)
            d.ctl("push", "s", b).ok()
            expect(show(d, "s")["generation"] == 1, "the name is not free")
            says(d.ctl("dataset", "restore", "s"), 1, "there is a dataset s already", "--as")
            number = show(d, "s")["id"]
            says(d.ctl("dataset", "rm", "s"), 0, "acutctl dataset restore %d brings it back" % number)
            says(d.ctl("dataset", "restore", "s"), 2, "2 datasets were called s", "restore one by its number")
            says(d.ctl("dataset", "restore", "99"), 4, "no removed dataset")
        with e2e.Daemon(base) as d:
            ids = {r["files"]: r["id"] for r in removed(d)}
            expect(names(d) == [] and len(ids) == 2, "%s" % removed(d))
            says(d.ctl("dataset", "restore", str(ids[2])), 0)
            says(d.ctl("dataset", "restore", "s", "--as", "."), 2, "cannot name a dataset")
            says(d.ctl("dataset", "restore", "s", "--as", "t"), 0)
            says(d.ctl("dataset", "rm", "t"), 0, "acutctl dataset restore t brings it back")
            says(d.ctl("dataset", "restore", "t"), 0)
            expect(names(d) == ["s", "t"] and removed(d) == [], "%s" % names(d))
            expect(mesh(d, "s", "--at", "1") == first and mesh(d, "s")["digest"] == whole, "it is not what it was")
            expect(show(d, "t")["files"] == 1, "%s" % show(d, "t"))
            d.ctl("push", "t", a).ok()
            expect(mesh(d, "t")["digest"] == whole, "a restored dataset takes no push")


def deleted_after_a_time():
    """After its time a removed dataset is deleted, and its disk space is free; not if it was restored, and not while a job uses
    it."""
    with e2e.Folder() as base:
        a = cloud(base, "a.las", 1, 0, 0, 30000)
        with Configured(base, "") as d:
            for name in ("s", "t"):
                d.ctl("push", name, a).ok()
            job = d.ctl("submit", "s", "--wait").ok().out.split()[0]
            d.ctl("dataset", "rm", "s").ok()
            d.ctl("dataset", "rm", "t").ok()
            d.ctl("dataset", "restore", "t").ok()
            kept = sorted(os.listdir(os.path.join(d.state, "datasets")))
            expect(len(kept) == 2, "%s" % kept)
            d.reload("keep-removed = 2s\n")
            e2e.until(lambda: removed(d) == [] and len(os.listdir(os.path.join(d.state, "datasets"))) == 1, "a removed dataset stays")
            expect(removed(d) == [] and names(d) == ["t"], "%s" % removed(d))
            says(d.ctl("dataset", "restore", "s"), 4, "no removed dataset")
            says(d.ctl("fetch", job, "-o", os.path.join(base, "m.ply")), 1, "dataset of job %s is gone" % job)
            expect(d.ctl("show", job, "--json").ok().json()["state"] == "done", "its job is gone")
            expect(mesh(d, "t")["points"] == 30000, "the other one lacks points")
            d.ctl("dataset", "rm", "t").ok()
        time.sleep(2)
        with e2e.Daemon(base, args=["--keep-removed", "2s"]) as d:
            says(d.ctl("dataset", "restore", "t"), 4, "no removed dataset")
            e2e.until(lambda: not os.listdir(os.path.join(d.state, "datasets")), "a removed dataset stays after a restart")


if __name__ == "__main__":
    e2e.main(remove_and_restore, deleted_after_a_time)
