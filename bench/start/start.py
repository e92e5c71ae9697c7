#!/usr/bin/python3
"""start.py BUILD: how long acutd takes to start after it was killed, and to list what it has, with 1,000 datasets, 10,000 jobs
that are over, 100 interrupted pushes, 100,000 stored domains, and what a one-step push leaves.

The store is made of tests/fixtures/state-4: its datasets many times, its jobs many times. Prints a line of JSON; medians of
five starts, seconds. Starts end with the first answer to a ping."""
import ctypes
import json
import os
import shutil
import signal
import sqlite3
import statistics
import struct
import subprocess
import sys
import tarfile
import tempfile
import time

TOP = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
DATASETS, JOBS, PENDING, DOMAINS, LEFT = 1000, 10000, 100, 100000, 256 << 20


class Digest(ctypes.Structure):
    _fields_ = [("low", ctypes.c_uint64), ("high", ctypes.c_uint64)]


XXH = ctypes.CDLL("libxxhash.so.0").XXH3_128bits
XXH.argtypes, XXH.restype = [ctypes.c_char_p, ctypes.c_size_t], Digest


def checksum(values):
    """Of a row, as its last column has it (daemon/catalogue/catalogue_sum.c)."""
    high = low = 0
    for v in values:
        value = struct.pack("<q", v) if isinstance(v, int) else v.encode()
        one = XXH(value, len(value))
        both = struct.pack("<6Q", high, low, one.high, one.low, not isinstance(v, int), len(value))
        one = XXH(both, len(both))
        high, low = one.high, one.low
    return high - (high >> 63 << 64)


def grow(base):
    """All of it below base: state, cache."""
    with tarfile.open(os.path.join(TOP, "tests/fixtures/state-4.tar.gz")) as tar:
        tar.extractall(base)
    state = base + "/state/"
    db = sqlite3.connect(state + "catalogue.db")
    columns = {t: [c[1] for c in db.execute("PRAGMA table_info(%s)" % t)] for t in ("dataset", "job", "push")}
    rows = {t: [dict(zip(columns[t], r)) for r in db.execute("SELECT * FROM %s ORDER BY id" % t)] for t in columns}

    def put(table, row):
        db.execute("INSERT INTO %s VALUES (%s)" % (table, ",".join("?" * len(row))), list(row.values()))

    valley, ridge, push = rows["dataset"][0], rows["dataset"][1], rows["push"][0]
    now = int(time.time() * 1e6)
    for i in range(3, DATASETS + 1):
        of = valley if i <= PENDING + 1 else ridge
        put("dataset", dict(of, id=i, name="set-%04d" % i))
        os.mkdir(state + "datasets/%d" % i)
        for name in os.listdir(state + "datasets/%d" % of["id"]):
            to = name
            if name.startswith("push-%d." % push["id"]) and of is valley:
                to = name.replace("push-%d." % push["id"], "push-%d." % (1000 + i), 1)
            shutil.copy2(state + "datasets/%d/%s" % (of["id"], name), state + "datasets/%d/%s" % (i, to))
        if of is valley:
            put("push", dict(push, id=1000 + i, dataset=i, begun_us=now))
    db.execute("UPDATE push SET begun_us = ?", (now,))
    for i in range(len(rows["job"]) + 1, JOBS + 1):
        put("job", dict(rows["job"][i % len(rows["job"])], id=i, dataset=1 + i % DATASETS, submitted_us=now, finished_us=now))
        shutil.copy2(state + "plans/plan-1", state + "plans/plan-%d" % i)
    db.commit()
    db.close()
    for i in range(DOMAINS):
        folder = base + "/cache/domains/%02x" % (i % 256)
        os.makedirs(folder, exist_ok=True)
        with open(folder + "/%030x" % i, "wb") as f:
            f.write(b"x" * 64)


def put_sums(state):
    """Rows that were taken over have none; those that this version writes do."""
    db = sqlite3.connect(state + "/catalogue.db")
    for table in ("dataset", "job", "push"):
        for row in db.execute("SELECT * FROM %s" % table).fetchall():
            db.execute("UPDATE %s SET sum = ? WHERE id = ?" % table, (checksum(row[:-1]), row[0]))
    db.commit()
    db.close()


def main():
    build = os.path.abspath(sys.argv[1])
    base = tempfile.mkdtemp(prefix="acut-start-")
    socket = base + "/s"
    ctl = [build + "/client/acutctl/acutctl", "--socket", socket]
    times = {"start": [], "jobs": [], "datasets": []}
    try:
        grow(base)
        for turn in range(6):
            os.makedirs(base + "/cache/one-step/1", exist_ok=True)
            with open(base + "/cache/one-step/1/push-1.0.run", "wb") as f:
                f.write(b"y" * LEFT)
                os.fsync(f.fileno())
            begun = time.monotonic()
            p = subprocess.Popen([build + "/daemon/acutd", "--no-config", "--socket", socket, "--state", base + "/state", "--cache",
                                  base + "/cache", "--memory", "64M", "--log-level", "warning"])
            while subprocess.run(ctl + ["ping"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode:
                if p.poll() is not None:
                    sys.exit("acutd ended with %d" % p.returncode)
                time.sleep(0.001)
            took = {"start": time.monotonic() - begun}
            for what in ("jobs", "datasets"):
                begun = time.monotonic()
                lines = subprocess.run(ctl + [what, "--json"], check=True, stdout=subprocess.PIPE).stdout.count(b"\n")
                took[what] = time.monotonic() - begun
                if lines < (JOBS if what == "jobs" else DATASETS):
                    sys.exit("%d %s are listed" % (lines, what))
            with open("/proc/%d/status" % p.pid) as f:
                peak = [int(line.split()[1]) for line in f if line.startswith("VmHWM")][0] / 1024
            with open("/proc/%d/stat" % p.pid) as f:
                ticks = f.read().split()
            time.sleep(1)
            with open("/proc/%d/stat" % p.pid) as f:
                later = f.read().split()
            idle = (int(later[13]) + int(later[14]) - int(ticks[13]) - int(ticks[14])) / os.sysconf("SC_CLK_TCK")
            p.send_signal(signal.SIGKILL)
            p.wait()
            if turn:  # the first one takes the store over from an older version
                for what in times:
                    times[what].append(took[what])
            else:
                first = took["start"]
                put_sums(base + "/state")
        print(json.dumps({"first_start": round(first, 3), **{k + "_seconds": round(statistics.median(v), 3) for k, v in times.items()},
                          "worst_start": round(max(times["start"]), 3), "vmhwm_mib": round(peak, 1), "cpu_in_a_second": idle}))
    finally:
        shutil.rmtree(base)


main()
