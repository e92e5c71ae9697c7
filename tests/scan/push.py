"""Spools pushed into datasets: the same mesh as from a LAS file of the same points; exactly once, whatever is killed and when;
corrected poses replace the first ones; texts and LAS files are passed on."""
import json
import os
import pty
import random
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import e2e
from drive import CLOCK, DATA, START, Drive, Survey, scan, spool
from e2e import Daemon, Folder, expect, main

XYZ = "[framer]\nkind = line\ntelegram-max = 1K\n[decoder]\nname = xyz\ncolumns = xyz\n"
LAS = "[framer]\nkind = las\n[decoder]\nname = las\n"


def survey(base, name, seed=0, sweeps=25):
    """A spool with its poses; and the LAS of its points."""
    d = Drive(2.0, hz=25, seed=seed)
    path = spool(os.path.join(base, name + ".spool"), Survey(d, sweeps).records, None, "%032x" % (seed + 1))
    poses = d.csv(os.path.join(base, name + ".csv"))
    out = os.path.join(base, name + ".las")
    scan("push", path, "--pose", poses, "-o", out, "--crs", "EPSG:32632").ok()
    return path, poses, out


def push(d, *args, **kw):
    return scan("push", *args, socket=d.socket, **kw)


def lines(r):
    return [json.loads(line) for line in r.ok().out.splitlines()]


def digest(d, name):
    out = os.path.join(d.base, "mesh-%d.ply" % random.getrandbits(60))
    job = d.ctl("submit", name, "--wait", "--json").ok().json()
    return job["digest"], job["vertex_digest"]


def dataset(d, name):
    return d.ctl("dataset", "show", name, "--json").ok().json()


def same_as_a_file():
    with Folder() as base, Daemon(base) as d:
        path, poses, las = survey(base, "a")
        args = [path, "--pose", poses, "--crs", "EPSG:32632", "--json"]
        got, = lines(push(d, *args, "--into", "s"))
        d.ctl("push", "f", las).ok()
        expect(got["state"] == "staged" and got["generation"] == 1 and got["points"] > 1500 and got["moved"] == 0, str(got))
        expect(digest(d, "s") == digest(d, "f"), "the mesh of the spool is not that of the file")
        shown = dataset(d, "s")
        expect(shown["points"] == got["points"] and shown["crs"] == "EPSG:32632", str(shown))
        # again: nothing
        again, = lines(push(d, *args, "--into", "s"))
        expect(again["state"] == "known" and again["points"] == got["points"] and dataset(d, "s")["generation"] == 1, str(again))
        # the same points as a file, by their content
        known = d.ctl("push", "s", "--checksum", "--json", las).ok().json()
        expect(known["state"] == "known", str(known))
        # under another name, from another folder
        os.rename(path, path + ".moved")
        again, = lines(push(d, path + ".moved", *args[1:], "--into", "s"))
        expect(again["state"] == "known", str(again))
        files = d.ctl("dataset", "log", "s", "--files").ok().out
        expect("spool:%032x" % 1 in files and "a.spool" in d.ctl("dataset", "log", "s", "--files", "--json").ok().out, files)


def corrected_poses():
    with Folder() as base, Daemon(base) as d:
        path, poses, las = survey(base, "a")
        other, poses2, las2 = survey(base, "b", 1)
        lines(push(d, path, "--pose", poses, "--into", "s", "--json"))
        lines(push(d, other, "--pose", poses2, "--into", "s", "--json"))
        better = Drive(2.0, hz=25).csv(os.path.join(base, "better.csv"), shift=0.25)
        refused = push(d, path, "--pose", better, "--into", "s")
        expect(refused.status == 1 and "--replace" in refused.err and "--add" not in refused.err, refused.err)
        expect("has this capture already" in refused.err and "name:" not in refused.err, refused.err)
        expect(dataset(d, "s")["generation"] == 2, "something was taken")
        got, = lines(push(d, path, "--pose", better, "--into", "s", "--replace", "--json"))
        expect(got["state"] == "staged" and got["replaced"] == 1 and got["generation"] == 3, str(got))
        scan("push", path, "--pose", better, "-o", os.path.join(base, "better.las")).ok()
        scan("push", other, "--pose", poses2, "-o", os.path.join(base, "plain.las")).ok()
        d.ctl("push", "f", os.path.join(base, "better.las"), os.path.join(base, "plain.las")).ok()
        expect(digest(d, "s") == digest(d, "f"), "not the better points alone")
        again, = lines(push(d, path, "--pose", better, "--into", "s", "--replace", "--json"))
        expect(again["state"] == "known" and dataset(d, "s")["generation"] == 3, str(again))


def said_clearly():
    with Folder() as base, Daemon(base) as d:
        path, poses, _ = survey(base, "a")
        none = push(d, path, "--into", "s")
        expect(none.status == 2 and "--pose" in none.err and "recorded" in none.err, none.err)
        for args, status, word in (
                ([path, "--pose", poses], 2, "--into"),
                ([path, "--pose", poses + "x", "--into", "s"], 1, "no such file"),
                ([path + "x", "--pose", poses, "--into", "s"], 1, "no such file"),
                ([poses, "--pose", poses, "--into", "s"], 1, poses),
                ([path, path, "--pose", poses, "--into", "s"], 2, "same capture"),
                ([path, "--pose", path, "--into", "s"], 1, path),
                ([path, "--pose", poses, "--into", "s", "--profile", "nothing"], 2, "nothing"),
                ([path, "--pose", poses, "--into", "s", "--utm", "32N"], 2, "--utm"),
                ([path, "--pose", poses, "--into", "s", "--heading", "true"], 2, "--crs"),
                ([path, "--pose", poses, "--into", "s", "--name", "a/b"], 2, "--name")):
            r = push(d, *args)
            expect(r.status == status and word in r.err, "%s: %d %s" % (args[1:], r.status, r.err))
        expect(d.ctl("datasets").ok().out.count("s ") == 0, "a dataset came to be")
        away = scan("push", path, "--pose", poses, "--into", "s", socket=base + "/nobody")
        expect(away.status == 69, away.err)
        # times of GPS as receivers write them; a profile as a file
        rows = open(poses).read().splitlines()
        for start, more, word in ((345600, [], "GPS week"), (345600, ["--pose-clock", "gps"], "GPS week"),
                                  (1384035218, [], "since 1980"), (1384035218, ["--pose-clock", "gps"], "since 1980"),
                                  (1500000000, [], "--pose-offset")):
            with open(base + "/gps.csv", "w") as f:
                f.write("\n".join([rows[0]] + ["%.2f,%s" % (start + 0.04 * i, row.split(",", 1)[1]) for i, row in enumerate(rows[1:])]))
            r = push(d, path, "--pose", base + "/gps.csv", "--into", "s", *more)
            expect(r.status == 1 and word in r.err, r.err)
        os.chdir(base)
        r = scan("push", path, "--pose", poses, "-o", base + "/conf.las", "--profile", "a.spool.conf")
        expect(r.status == 0, r.err)
        # a bad spool among good ones
        r = push(d, path, poses, "--pose", poses, "--into", "s", "--json")
        told = [json.loads(line) for line in r.out.splitlines()]
        expect(r.status == 3 and [t["state"] for t in told] == ["staged", "refused"] and told[1]["error"]["code"] == "bad-input", r.out)
        # for people
        r = push(d, path, "--pose", poses, "--into", "s2").ok()
        expect("poses over" in r.err and "shots" in r.err and "generation 1" in r.err, r.err)


def a_damaged_digit():
    """One impossible pose costs the shots beside it, not the spool. With many of them the push is refused: it is not known which
    are right."""
    with Folder() as base, Daemon(base) as d:
        path, poses, _ = survey(base, "a")
        with open(poses) as f:
            rows = f.read().splitlines()

        def damaged(name, which):
            out = os.path.join(base, name + ".csv")
            with open(out, "w") as f:
                for i, row in enumerate(rows):
                    words = row.split(",")
                    if i in which:
                        words[2] = "9" + words[2]
                    f.write(",".join(words) + "\n")
            return out

        whole, = lines(push(d, path, "--pose", poses, "--crs", "EPSG:32632", "--into", "whole", "--json"))
        for name, which in (("middle", {len(rows) // 2}), ("first", {1})):
            got, = lines(push(d, path, "--pose", damaged(name, which), "--crs", "EPSG:32632", "--into", name, "--json"))
            far = got["dropped"]["too_far"]
            expect(got["state"] == "staged" and got["points"] + far == whole["points"] and got["points"] > far, "%s: %s" % (name, got))
            expect(far > 0 or name == "first", "%s: %s" % (name, got))
            expect(got["shots"] == got["points"] + sum(got["dropped"].values()), "shots do not add up: %s" % got)
            expect(dataset(d, name)["points"] == got["points"], "%s" % dataset(d, name))
        r = push(d, path, "--pose", damaged("most", set(range(2, len(rows), 2))), "--crs", "EPSG:32632", "--into", "most")
        expect(r.status == 1 and "too far from the first one" in r.err and "a.spool" in r.err, "%d %s" % (r.status, r.err))


def poses_take_long():
    """A terminal shows how much of a pose file was read."""
    with Folder() as base:
        path, poses, _ = survey(base, "a")
        child, terminal = pty.fork()
        if not child:
            os.environ["TERM"] = "xterm"
            scan = os.environ["ACUT_SCAN"]
            os.execv(scan, [scan, "push", path, "--pose", poses, "-o", base + "/shown.las", "--crs", "EPSG:32632"])
        seen = b""
        try:
            while more := os.read(terminal, 65536):
                seen += more
        except OSError:  # the program has closed its terminal
            pass
        os.close(terminal)
        expect(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, seen)
        expect(b"a.csv: " in seen and b" of " in seen, seen)


def planes():
    """The dataset's own plane; combinations that do not fit are refused."""
    with Folder() as base, Daemon(base) as d:
        where = Drive(2.0, where=(48.2, 11.6))
        path = spool(base + "/a.spool", Survey(where, 15, 32, flat=300).records)
        poses = where.csv(base + "/a.csv")
        d.ctl("dataset", "create", "wgs", "--crs", "EPSG:32633").ok()
        got, = lines(push(d, path, "--pose", poses, "--into", "wgs", "--json"))
        expect(got["crs"].startswith("EPSG:32633"), str(got))
        d.ctl("dataset", "create", "etrs", "--crs", "EPSG:25832").ok()
        r = push(d, path, "--pose", poses, "--into", "etrs")
        expect(r.status == 2 and "EPSG:4258" in r.err, r.err)
        got, = lines(push(d, path, "--pose", poses, "--into", "etrs", "--crs", "EPSG:4258", "--json"))
        expect(got["crs"] == "EPSG:25832 + EPSG:5019", str(got))
        got, = lines(push(d, path, "--pose", poses, "--into", "new", "--json"))
        expect(got["crs"] == "EPSG:32632 + EPSG:5030" and got["zone"] == "32N", str(got))
        r = push(d, path, "--pose", poses, "--into", "new", "--utm", "33N")
        expect(r.status == 2 and "32N" in r.err, r.err)
        # the dataset's plane for the second spool, too; known
        got, = lines(push(d, path, "--pose", poses, "--into", "new", "--json"))
        expect(got["state"] == "known", str(got))
        r = push(d, path, "--pose", poses, "--into", "new", "--crs", "EPSG:32633")
        expect(r.status == 1 and "EPSG:32633" in r.err, r.err)


def no_guess():
    """Missing information is not guessed: units, ellipsoids, the kind of heights."""
    with Folder() as base, Daemon(base) as d:
        path, poses, _ = survey(base, "a")
        with open(base + "/u.xyz", "w") as f:
            f.write("".join("%d %d 300\n" % (500000 + i, 5400000 + i * i) for i in range(50)))
        d.ctl("push", "none", base + "/u.xyz").ok()
        d.ctl("push", "code", base + "/u.xyz", "--assume-crs", "EPSG:2263").ok()
        d.ctl("push", "said", base + "/u.xyz", "--assume-crs", "EPSG:2263", "--assume-units", "ftUS,ftUS").ok()
        d.ctl("dataset", "create", "high", "--crs", "EPSG:32632 + EPSG:5773").ok()
        args = [path, "--pose", poses]
        for more, status, word in (
                (["--into", "none"], 2, "would be a guess"),
                (["--into", "code"], 2, "would be a guess"),
                (["--into", "code", "--crs", "EPSG:2263"], 2, "would be a guess"),
                (["--into", "new", "--crs", "EPSG:2263"], 2, "the unit of its heights is unknown"),
                (["--into", "new", "--crs", "EPSG:100"], 2, "no system that acut knows of EPSG"),
                (["--into", "high", "--crs", "EPSG:32632 + EPSG:7837"], 1, "heights of one kind"),
                (["--into", "new", "--geoid", "flat"], 2, "ellipsoidal_height")):
            r = push(d, *args, *more)
            expect(r.status == status and word in r.err, "%s: %d %s" % (more, r.status, r.err))
        # feet that are said; a plane that has heights, named without them
        got, = lines(push(d, *args, "--into", "said", "--json"))
        expect(got["state"] == "staged" and dataset(d, "said")["units"] == {"xy": "us-survey-foot", "z": "us-survey-foot"}, str(got))
        # of a new one and of one that has points
        for _ in range(2):
            got, = lines(push(d, *args, "--into", "high", "--crs", "EPSG:32632", "--json"))
            expect(got["crs"] == "EPSG:32632 + EPSG:5773" and dataset(d, "high")["points"] == got["points"], str(got))
        text = open(poses).read().replace("height", "ellipsoidal_height")
        with open(poses, "w") as f:
            f.write(text)
        r = push(d, *args, "--into", "e")
        expect(r.status == 1 and "ellipsoid" in r.err and "--crs" in r.err, r.err)


def geoid(path, height):
    """A grid of one height, 10 degrees."""
    with open(path, "wb") as f:
        f.write(b"P5\n# Description A grid of the tests\n# Offset -108\n# Scale 0.003\n36 19\n65535\n")
        f.write(struct.pack(">H", round((height + 108) / 0.003)) * (36 * 19))
    return path


def heights():
    """Ellipsoidal heights are marked, do not mix with others, and become orthometric on request."""
    with Folder() as base, Daemon(base) as d:
        where = Drive(2.0, where=(48.2, 11.6))
        path = spool(base + "/a.spool", Survey(where, 15, 32, flat=300).records)
        poses = where.csv(base + "/a.csv")
        d.ctl("geoid", "add", geoid(base + "/flat.pgm", 45)).ok()
        args = [path, "--pose", poses, "--into", "o", "--geoid", "flat", "--json"]
        got, = lines(push(d, *args))
        shown = dataset(d, "o")
        expect(got["state"] == "staged" and shown["crs"] == "EPSG:32632 + orthometric height (flat)", str(shown))
        scan("push", path, "--pose", poses, "-o", base + "/o.las").ok()
        d.ctl("push", "f", "--geoid", "flat", base + "/o.las").ok()
        expect(digest(d, "o") == digest(d, "f") and dataset(d, "f")["crs"] == shown["crs"], "not as acutctl does it")
        got, = lines(push(d, *args))
        expect(got["state"] == "known", str(got))
        r = push(d, path, "--pose", poses, "--into", "o", "--replace")
        expect(r.status == 1 and "--geoid" in r.err, r.err)
        # a dataset of other heights does not take ellipsoidal ones
        d.ctl("dataset", "create", "nn", "--crs", "EPSG:32632 + EPSG:5783").ok()
        r = push(d, path, "--pose", poses, "--into", "nn")
        expect(r.status == 1 and "ellipsoidal" in r.err, r.err)
        text = open(poses).read().replace("ellipsoidal_height", "height")
        with open(poses, "w") as f:
            f.write(text)
        got, = lines(push(d, path, "--pose", poses, "--into", "nn", "--json"))
        expect(got["crs"] == "EPSG:32632 + EPSG:5783" and got["heights"] == "as-posed", str(got))


def text_and_las():
    """Spools with points need no poses; bad lines are counted and left out."""
    with Folder() as base, Daemon(base) as d:
        rng = random.Random(5)
        rows = ["%.3f %.3f %.3f" % (rng.uniform(0, 900), rng.uniform(0, 900), rng.uniform(0, 9)) for _ in range(4000)]
        xyz = "\n".join(rows[:2000] + ["# a word", "1 2 x", "12 \x01 3", "", "laser off", "13,.358 -387.77 -785.771"] + rows[2000:]) + "\n"
        with open(base + "/good.xyz", "w") as f:
            f.write("\n".join(rows) + "\n")
        cut = [xyz[i:i + 777].encode() for i in range(0, len(xyz), 777)]
        path = spool(base + "/t.spool", [(DATA, i + 1, c) for i, c in enumerate(cut)], XYZ)
        got, = lines(push(d, path, "--into", "t", "--json"))
        d.ctl("push", "f", base + "/good.xyz").ok()
        expect(got["points"] == 4000 and got["bad_telegrams"] == 3 and got["answers"] == 3 and got["telegrams"] == 4006 and got["shots"] is None, str(got))
        r = push(d, path, "--into", "t")
        expect("3 bad telegrams skipped, 3 lines that hold no point" in r.err, r.err)
        expect(digest(d, "t") == digest(d, "f"), "another mesh than that of the lines")
        again, = lines(push(d, path, "--into", "t", "--json"))
        expect(again["state"] == "known", str(again))
        # two LAS files, the second torn by an unplug, a third
        whole = []
        for seed in (1, 2, 3):
            e2e.run([e2e.SYNTH, "--points", "3000", "--seed", str(seed), base + "/%d.las" % seed]).ok()
            whole.append(open(base + "/%d.las" % seed, "rb").read())
        def pieces(data, t):
            return [(DATA, t + i, data[i:i + 5000]) for i in range(0, len(data), 5000)]
        records = pieces(whole[0], 1) + pieces(whole[1][:50000], 10**6) + [(2, 2 * 10**6, b"left")] + pieces(whole[2], 3 * 10**6)
        path = spool(base + "/l.spool", records, LAS, "ee" * 16)
        got = lines(push(d, path, "--into", "l", "--json"))
        d.ctl("push", "g", base + "/1.las", base + "/3.las").ok()
        expect([g["state"] for g in got] == ["staged", "staged"] and [g["points"] for g in got] == [3000, 3000], str(got))
        expect(digest(d, "l") == digest(d, "g"), "another mesh than that of the files")
        expect([g["state"] for g in lines(push(d, path, "--into", "l", "--json"))] == ["known", "known"], "not known")


def enormous():
    """A coordinate with more digits than a text may have is a bad line, which is left out. One that is only far away refuses the
    spool by name, as it does a file; other spools of the push count."""
    with Folder() as base, Daemon(base) as d:
        rng = random.Random(5)
        rows = ["%.3f %.3f %.3f" % (rng.uniform(0, 900), rng.uniform(0, 900), rng.uniform(0, 9)) for _ in range(400)]

        def of(name, n, *more):
            text = "\n".join(rows[:200] + list(more) + rows[200:]) + "\n"
            return spool(os.path.join(base, name), [(DATA, 1, text.encode())], XYZ, "%032x" % n)

        got, = lines(push(d, of("digits.spool", 1, "1e25 1 1", "1 -12345678901234567890 1", "1 1 1e-30"), "--into", "s", "--json"))
        expect(got["state"] == "staged" and got["points"] == 400 and got["bad_telegrams"] == 3, str(got))
        good = of("good.spool", 2)
        for i, row in enumerate(("123456789012345678 1 1", "1 -1e17 1", "1 1 4e12")):
            far = of("far%d.spool" % i, 3 + i, row)
            r = push(d, far, "--into", "far%d" % i)
            expect(r.status == 1 and "far%d.spool" % i in r.err and "does not fit into 32 bits" in r.err, "%d %s" % (r.status, r.err))
            r = push(d, far, good, "--into", "both%d" % i)
            expect(r.status == 3 and "far%d.spool" % i in r.err and dataset(d, "both%d" % i)["points"] == 400, "%d %s" % (r.status, r.err))


def compressed():
    """LAZ in a stream of LAS is refused by name, with a hint that works."""
    with Folder() as base, Daemon(base) as d:
        e2e.run([e2e.SYNTH, "--points", "3000", base + "/1.las"]).ok()
        head = bytearray(open(base + "/1.las", "rb").read())
        head[104] |= 0x80 # as LASzip does
        path = spool(base + "/z.spool", [(DATA, 1, bytes(head))], LAS)
        r = push(d, path, "--into", "z")
        expect(r.status == 1 and "LAZ" in r.err and "--to raw" in r.err, r.err)
        said = scan("replay", path, "--json").ok().json()["bad"]
        expect(said["compressed"] == 1, str(said))
        scan("replay", path, "--to", "raw", "-o", base + "/z.laz").ok()
        expect(open(base + "/z.laz", "rb").read() == bytes(head), "other bytes")
        expect("z " not in d.ctl("datasets").ok().out, "a dataset came to be")


def growing():
    """A spool that is unfinished and torn at its end, then longer."""
    with Folder() as base, Daemon(base) as d:
        drive = Drive(2.0, hz=25)
        records = Survey(drive, 25).records
        poses = drive.csv(base + "/a.csv")
        path = spool(base + "/a.spool", records[:12], None, "ab" * 16, 1700000000, "open")
        with open(path, "ab") as f:
            f.write(b"torn")
        got, = lines(push(d, path, "--pose", poses, "--into", "s", "--json"))
        expect(not got["ended"] and got["torn_bytes"] == 4 and got["sweeps"] == 12, str(got))
        os.unlink(path)
        spool(path, records, None, "ab" * 16)
        r = push(d, path, "--pose", poses, "--into", "s")
        expect(r.status == 1 and "--replace" in r.err, r.err)
        got, = lines(push(d, path, "--pose", poses, "--into", "s", "--replace", "--json"))
        expect(got["sweeps"] == 25 and got["replaced"] == 1 and dataset(d, "s")["points"] == got["points"], str(got))


def clock_set():
    """The computer's clock is set during a capture: this is reported, and the later shots have no poses."""
    with Folder() as base:
        drive = Drive(2.0, hz=25)
        records = Survey(drive, 25).records
        at = records[12][1] - 1000
        records.insert(12, (CLOCK, at, struct.pack("<q", int((START + 3600) * 1e9) + at)))
        path, poses = spool(base + "/a.spool", records), drive.csv(base + "/a.csv")
        got, = lines(scan("push", path, "--pose", poses, "-o", base + "/a.las", "--json"))
        dropped = got["dropped"]
        expect(got["clock_sets"] == 1 and abs(got["clock_moved_s"] - 3600) < 1e-3, str(got))
        expect(got["shots"] == 2250 and got["points"] == 1080 and dropped["after_poses"] == 1170, str(got))
        r = scan("push", path, "--pose", poses, "-o", base + "/b.las")
        expect(r.status == 0 and "clock was set 1 time while" in r.err, r.err)


def many_spools():
    """More spools than fit into one push."""
    with Folder() as base, Daemon(base) as d:
        drive = Drive(2.0, hz=25)
        records = Survey(drive, 12).records
        poses = drive.csv(base + "/a.csv")
        paths = [spool(base + "/%d.spool" % i, records[i:i + 1], None, "%032x" % (i + 100)) for i in range(11)]
        got = lines(push(d, *paths, "--pose", poses, "--into", "s", "--json"))
        expect([g["generation"] for g in got] == [1] * 8 + [2] * 3, str(got))
        whole = spool(base + "/w.spool", records[:11], None, "cd" * 16)
        lines(push(d, whole, "--pose", poses, "--into", "w", "--json"))
        expect(digest(d, "s") == digest(d, "w"), "in parts another mesh than in one")
        expect([g["state"] for g in lines(push(d, *paths, "--pose", poses, "--into", "s", "--json"))] == ["known"] * 11, "not known")


class Cut:
    """A proxy that cuts the connection to the daemon after the client's frame number `after`: the daemon has the frame, its
    answer is lost. `instead`: called with the connection still open, before an answer comes through. `knows`: an uncut proxy of
    the same client, which has seen the answers before the client goes on."""

    def __init__(self, d, path, after=0, instead=None, knows=None):
        self.path, self.after, self.frames, self.target, self.instead = path, after, 0, d.socket, instead
        self.answered, self.waits = set(), knows.answered if knows else ()
        self.door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.door.bind(path)
        self.door.listen()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def frame(self, c, to):
        data, fds = b"", []
        while len(data) < 16 or len(data) < 16 + int.from_bytes(data[4:8], "little"):
            want = 16 - len(data) if len(data) < 16 else 16 + int.from_bytes(data[4:8], "little") - len(data)
            part, got, _, _ = socket.recv_fds(c, want, 8)
            fds += got
            if not part:
                return False
            data += part
        socket.send_fds(to, [data], fds)
        for fd in fds:
            os.close(fd)
        return True

    def run(self):
        c, _ = self.door.accept()
        s = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        s.connect(self.target)
        try:
            while True:
                ready = select.select([c, s], [], [])[0]
                if s in ready:
                    self.answered.add(self.frames)
                    if not self.frame(s, c):
                        break
                if c in ready:
                    if not self.frame(c, s):
                        break
                    self.frames += 1
                    if self.frames == self.after and self.instead:
                        self.instead()
                    elif self.frames == self.after:
                        # it is done, or waits for more
                        select.select([s], [], [], e2e.PATIENCE if self.after in self.waits else 0)
                        break
        except OSError:
            pass
        c.close()
        s.close()
        self.door.close()


def answers_are_lost():
    """The connection ends after each message in turn, including the commit."""
    with Folder() as base, Daemon(base) as d:
        made = [Survey(Drive(2.0, hz=25), 14).records[7 * i:7 * i + 7] for i in range(2)]
        poses = Drive(2.0, hz=25).csv(base + "/a.csv")
        paths = [spool(base + "/%d.spool" % i, made[i], None, "%032x" % (i + 7)) for i in range(2)]
        args = [*paths, "--pose", poses, "--crs", "EPSG:32632", "--json"]
        lines(push(d, *args, "--into", "want"))
        want, points = digest(d, "want"), dataset(d, "want")["points"]
        states, k = set(), 0
        whole = Cut(d, base + "/whole")
        scan("push", *args, "--into", "whole", socket=whole.path).ok()
        while True:
            k += 1
            name = "k%d" % k
            way = Cut(d, base + "/cut%d" % k, k, knows=whole)
            r = scan("push", *args, "--into", name, socket=way.path)
            if r.status == 0:
                break
            expect(r.status == 69, "cut behind %d: %d %s" % (k, r.status, r.err))
            got = lines(push(d, *args, "--into", name))
            states.update(g["state"] for g in got)
            shown = dataset(d, name)
            expect(shown["points"] == points and shown["generation"] == 1 and not shown.get("pending"), "cut behind %d: %s" % (k, shown))
            expect(digest(d, name) == want, "cut behind %d: another mesh" % k)
        expect(k > 9 and states == {"staged", "adopted", "known"}, "%d messages, %s" % (k, states))


def exactly_once():
    """Client and daemon are killed after any message, including the commit. The command is repeated, and each spool is there
    once."""
    with Folder() as base:
        poses = os.path.join(base, "all.csv")
        # one file of poses for all three: their times are one after the other
        drives = [Drive(2.0, hz=25, seed=s, start=1700000000 + 100 * s) for s in range(3)]
        with open(poses, "w") as f:
            for i, each in enumerate(drives):
                text = open(each.csv(base + "/one.csv")).read()
                f.write(text if i == 0 else text.split("\n", 1)[1])
        paths = [spool(base + "/%d.spool" % i, Survey(Drive(2.0, hz=25, seed=i), 20).records, None, "%032x" % (i + 50), 1700000000 + 100 * i)
                 for i in range(3)]
        args = [*paths, "--pose", poses, "--crs", "EPSG:32632", "--json"]
        d = Daemon(base, threads=1).start()
        try:
            whole = Cut(d, base + "/whole")
            first = lines(scan("push", *args, "--into", "want", socket=whole.path))
            want, points = digest(d, "want"), dataset(d, "want")["points"]
            rng = random.Random(int(os.environ.get("ACUT_TEST_SEED", "7")))
            cut = 0
            for i in range(14):
                name = "s%d" % (i // 2)
                what, later, client = rng.choice(["client", "daemon", "both"]), rng.choice([0, 0.005, 0.05]), []

                def kill():
                    time.sleep(later) # it gets on with what it has
                    if what != "daemon":
                        e2e.until(lambda: client, "no client")[0].kill()
                    if what != "client":
                        d.stop(signal.SIGKILL)

                way = Cut(d, base + "/kill%d" % i, rng.randrange(1, whole.frames + 1), kill)
                client.append(subprocess.Popen([os.environ["ACUT_SCAN"], "push", *args, "--into", name, "--socket", way.path],
                                               stdout=subprocess.PIPE, stderr=subprocess.PIPE))
                client[0].communicate(timeout=e2e.PATIENCE)
                way.thread.join()
                cut += client[0].returncode != 0
                if d.process.poll() is not None:
                    d = Daemon(base, threads=1).start()
            for i in range(7):
                got = lines(push(d, *args, "--into", "s%d" % i))
                shown = dataset(d, "s%d" % i)
                expect([g["points"] for g in got] == [g["points"] for g in first], str(got))
                expect(shown["points"] == points and shown["generation"] == 1, "after kills: %s" % shown)
                expect(not shown.get("pending"), "a pending push stays: %s" % shown)
                expect(digest(d, "s%d" % i) == want, "another mesh after kills")
            expect(cut >= 7, "only %d pushes were cut off" % cut) # the first of each name at least
        finally:
            d.stop(signal.SIGKILL)


if __name__ == "__main__":
    only = sys.argv[1:]
    cases = (same_as_a_file, corrected_poses, said_clearly, a_damaged_digit, poses_take_long, planes, no_guess, heights, text_and_las, enormous, compressed, growing, clock_set, many_spools, answers_are_lost,
             exactly_once)
    main(*[c for c in cases if not only or c.__name__ in only])
