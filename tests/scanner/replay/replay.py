#!/usr/bin/env python3
"""acut-scan replay and profiles: what they say of spools that are whole, damaged, torn; what they write out.

replay.py ACUT_SCAN SPOOL_MAKE SOURCE_ROOT
"""
import csv, hashlib, io, json, math, os, struct, subprocess, sys, tempfile

SCAN, MAKE, ROOT = map(os.path.abspath, sys.argv[1:4])
TIM = ROOT + "/etc/scanners.d/sick-tim.conf"
FOLDER = ROOT + "/etc/scanners.d"
dir = tempfile.TemporaryDirectory(prefix="acut-replay-")
os.chdir(dir.name)


def scan(*words, status=0):
    r = subprocess.run([SCAN, *words], capture_output=True, timeout=180)
    assert r.returncode == status, (words, r.returncode, r.stdout[-2000:], r.stderr[-2000:])
    return r


def make(name, profile, *words):
    subprocess.run([MAKE, name, profile, *map(str, words)], check=True, timeout=180)
    return name


def report(*words, status=0):
    return json.loads(scan("replay", "--json", *words, status=status).stdout)


def counts():
    make("a.spool", TIM, "sweeps", 300, "lose", 5, "bad", 7, "twice", 9, "cut", 1000)
    r = report("a.spool")
    assert (r["telegrams"], r["bad_telegrams"], r["bad"]["undecodable"], r["sweeps"]) == (300, 1, 1, 299), r
    # the one that was lost, and the one that could not be decoded
    assert (r["lost_sweeps"], r["repeated_sweeps"], r["gaps"], r["device_restarts"]) == (2, 1, 0, 0), r
    assert r["ended"] and not r["torn_bytes"] and r["sha256_as_said"] and r["profile"] == "sick-tim"
    assert r["shots"] == 299 * 271 and 0.9 * r["shots"] < r["returns"] < r["shots"]
    assert r["faults"][0]["size"] > 1000 and "LMDscandata" in r["faults"][0]["reason"], r["faults"]
    assert int(r["faults"][0]["reason"].split("(byte ")[1].split()[0]) > 100, r["faults"]
    assert r["serial"] == r["device_serial"] == "17271466" and r["events"] == {"stop": 1}
    assert abs(r["last_utc_s"] - r["first_utc_s"] - 299 / 15) < 1e-3
    # the profile says 4 ms from the last shot to its arrival; from the first one it is three quarters of a turn
    assert abs(r["first_utc_s"] - (1782900000 - 0.004 - 0.05)) < 1e-5, r["first_utc_s"]
    text = scan("replay", "a.spool").stdout.decode()
    for part in "299 good, 1 bad", "undecodable 1", r["sha256"], "2 by the device's counter", "as it should be":
        assert part in text, (part, text)
    # the cut of the transfers is nothing that replay sees
    make("b.spool", TIM, "sweeps", 300, "lose", 5, "bad", 7, "twice", 9, "cut", 17)
    b = report("b.spool")
    for key in "telegrams", "sweeps", "shots", "returns", "sha256", "faults", "first_utc_s", "lost_sweeps":
        assert r[key] == b[key], key


def written_out():
    r = report("a.spool", "--to", "raw", "-o", "raw")
    raw = open("raw", "rb").read()
    assert hashlib.sha256(raw).hexdigest() == r["sha256"] and len(raw) == r["bytes"]
    assert scan("replay", "a.spool", "--to", "raw", "--quiet").stdout == raw
    again = scan("replay", "a.spool", "--to", "raw", "-o", "raw", status=2)
    assert b"there already" in again.stderr and open("raw", "rb").read() == raw
    telegrams = [json.loads(x) for x in scan("replay", "a.spool", "--to", "telegrams", "-q").stdout.splitlines()]
    assert len(telegrams) == 300
    for t in telegrams:
        assert raw[t["offset"]:t["offset"] + t["size"] + 2] == b"\2" + t["text"].encode() + b"\3"
    sweeps = [json.loads(x) for x in scan("replay", "a.spool", "--to", "sweeps").stdout.splitlines()]
    assert len(sweeps) == 299 and sum(s["lost"] for s in sweeps) == 2 and sum(s["repeated"] for s in sweeps) == 1
    rows = list(csv.DictReader(io.StringIO(scan("replay", "a.spool", "--to", "csv", "-q").stdout.decode())))
    assert len(rows) == 299 * 271
    # a room of 6 by 4 m, as it was made, with a centimetre of noise
    for s in sweeps[:20]:
        words = next(t for t in telegrams if t["telegram"] == s["telegram"])["text"].split()
        assert words[20] == "DIST1" and int(words[25], 16) == len(s["range_m"]) == len(s["intensity"])
        for i, v in enumerate(s["range_m"]):
            angle = math.radians(s["first_deg"] + i * s["step_deg"])
            wall = min(abs(2 / math.cos(angle)) if abs(math.cos(angle)) > 1e-9 else 99, abs(3 / math.sin(angle)) if abs(math.sin(angle)) > 1e-9 else 99)
            raw_value = int(words[26 + i], 16)
            assert (v is None) == (raw_value < 16)
            if v is not None:
                assert abs(v - raw_value / 1000) < 1e-5 and -0.001 < v - wall < 0.012, (i, v, wall)
    for row, want in zip(rows[:271], sweeps[0]["range_m"]):
        assert (float(row["range_m"]) if row["range_m"] else None) == want
    scan("replay", "a.spool", "--to", "points", status=2)
    scan("replay", "a.spool", "-o", "nothing", status=2)
    assert not os.path.exists("nothing")


def damage():
    whole = open("a.spool", "rb").read()
    make("u.spool", TIM, "sweeps", 50, "unended")
    r = report("u.spool")
    assert not r["ended"] and not r["torn_bytes"] and r["sweeps"] == 50
    open("t.spool", "wb").write(whole[:len(whole) * 2 // 3])
    r = report("t.spool")
    assert not r["ended"] and r["torn_bytes"] and 190 < r["sweeps"] < 202, r
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0x40
    open("f.spool", "wb").write(flipped)
    r = report("f.spool", status=74)
    assert r["damaged"] == 1 and r["ended"] and not r["sha256_as_said"] and r["gaps"] >= 1, r
    assert r["sweeps"] in (297, 298), r
    assert "damaged" in scan("replay", "f.spool", status=74).stderr.decode()
    open("n.spool", "wb").write(b"no spool" * 1000)
    assert json.loads(scan("replay", "n.spool", "--json", status=1).stdout)["error"]["code"] == "bad-input"
    scan("replay", "there-is-none.spool", status=74)


def points():
    lines = b"x y z\r\n1 2 3\r\n4 5\n7 8 9\n10 11 12"
    open("lines", "wb").write(lines)
    make("l.spool", FOLDER + "/generic-xyz.conf", "bytes", "lines", "cut", 5)
    assert scan("replay", "l.spool", "--to", "points", "-q").stdout == b"1 2 3\n7 8 9\n10 11 12\n"
    r = report("l.spool")
    assert (r["point_telegrams"], r["bad"]["undecodable"], r["answers"], r["sweeps"]) == (3, 1, 1, 0), r

    def las(n):
        head = bytearray(227)
        head[:4] = b"LASF"
        head[24:26] = b"\1\2"
        struct.pack_into("<HI", head, 94, 227, 227)
        struct.pack_into("<BHI", head, 104, 0, 20, n)
        return bytes(head) + bytes((i * 7) & 255 for i in range(n * 20))

    files = [las(10), las(20000), las(3)]
    open("files", "wb").write(files[0] + b"rubbish" + files[1] + files[2] + las(500)[:3000])
    make("f2.spool", FOLDER + "/generic-las.conf", "bytes", "files", "cut", 3001)
    r = report("f2.spool", "--to", "points", "-o", "out.las")
    assert r["files"] == 3 and r["bad"]["unfinished"] == 1, r
    for name, want in zip(("out.las", "out-2.las", "out-3.las"), files):
        assert open(name, "rb").read() == want
    assert not os.path.exists("out-4.las")


def profiles():
    r = json.loads(scan("profiles", "--json", "--profiles", FOLDER).stdout)
    assert [p["name"] for p in r["profiles"]] == ["generic-las", "generic-xyz", "sick-tim"]
    tim = r["profiles"][2]
    assert tim["match"]["vendor"] == 0x19A2 and tim["match"]["product"] == 0x5001 and tim["usb"]["endpoint_out"] == 2
    assert "does not support" in tim["note"]
    assert "does not support" in scan("profiles", "sick-tim", "--profiles", FOLDER).stdout.decode()
    os.mkdir("own")
    open("own/sick-tim.conf", "w").write("title = mine\n[usb]\ntransfer = 3\n")
    open("own/generic-las.conf", "w").close()
    r = scan("profiles", "--profiles", FOLDER, "--profiles", "own", status=1)
    assert b"line 3" in r.stderr and b"own/sick-tim.conf" in r.stderr and b"generic-las" not in r.stdout and b"broken" in r.stdout
    r = scan("profiles", "own/sick-tim.conf", status=1)
    assert b"transfers is likely meant" in r.stderr, r.stderr
    assert b"good" in scan("profiles", TIM).stdout
    scan("profiles", "no-such", "--profiles", FOLDER, status=4)
    # another profile than that of the spool; one that cannot be
    open("raw.conf", "w").write("[framer]\nkind = stx-etx\n")
    r = report("a.spool", "--profile", "./raw.conf")
    assert (r["telegrams"], r["sweeps"], r["answers"]) == (300, 0, 300)
    r = report("a.spool", "--profile", "./own/sick-tim.conf", status=1)
    assert "line 3" in r["error"]["message"], r


for step in counts, written_out, damage, points, profiles:
    step()
    print(step.__name__, "good")
