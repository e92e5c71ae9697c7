"""The bench suite's own programs: what they print can be read again and be compared. No time is looked at."""
import os
import re
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
BENCH = os.path.join(HERE, "../../bench")
BUILD = os.environ["ACUT_BUILD"]
OLD, NEW = os.path.join(HERE, "old.txt"), os.path.join(HERE, "new.txt")


def expect(good, text):
    if not good:
        sys.exit("FAILED: %s" % text)


def run(program, *args):
    r = subprocess.run([sys.executable, "-B", os.path.join(BENCH, program), *args], stdout=subprocess.PIPE,
                       stderr=subprocess.PIPE, timeout=600)
    return r.returncode, r.stdout.decode(), r.stderr.decode()


def marks(text):
    """{name: mark} of a comparison's rows."""
    return {row.split()[0]: row.split()[-1] for row in text.splitlines()[1:-1]}


def compare(folder):
    status, out, err = run("compare", OLD, NEW)
    got = marks(out)
    expect(status == 1, "a regression: %d %s" % (status, err))
    expect(got["whole/10M/wall"] == "WORSE" and got["laz/town/acut"] == "WORSE", "worse: %s" % out)
    expect(got["kernel/uniform/acut"] == "better", "better: %s" % out)
    expect(got["start/empty"] == "worse?", "within the noise: %s" % out)
    expect(got["kernel/uniform/cgal"] == "=" and got["floor/memory/read/one"] == "=", "references: %s" % out)
    expect(got["growth/10M/wall"] == "new" and got["second/10M/push"] == "gone", "of one file only: %s" % out)
    expect("whole/10M/peak" not in got, "5 %% is below the threshold: %s" % out)
    expect("6 lines in both" not in out and "7 lines in both, 2 worse by more than 1.1, 1 better" in out, out)
    expect(" 1.200  WORSE" in out and " 1.250  WORSE" in out, "the factors: %s" % out)
    expect(run("compare", "--threshold", "1.3", OLD, NEW)[0] == 0, "another threshold")
    expect(run("compare", OLD, OLD)[0] == 0, "a file with itself")
    status, out, _ = run("compare", "--all", OLD, NEW)
    expect("whole/10M/peak" in marks(out), "--all: %s" % out)


def refused(folder):
    bad = os.path.join(folder, "bad.txt")
    for text, says in (("# nothing\n", "no result lines"), ("whole/10M/wall 5 s\n", "line 1"),
                       ("a 1 s - 1 1 1\na 2 s - 1 2 2\n", "twice"), ("whole/10M/wall 5.0 ms - 1 5 5\n", "other")):
        with open(bad, "w") as f:
            f.write(text)
        status, out, err = run("compare", OLD, bad)
        expect(status == 2 and says in err, "%r: %d %s" % (text, status, err))
    expect(run("compare", OLD, os.path.join(folder, "none"))[0] == 2, "a file that is not there")
    for words in (["run", folder], ["large", BUILD, "5X"], ["large", BUILD, "900000G"], ["run", BUILD, "--only", "what"]):
        status, out, err = run(*words)
        expect(status == 2 and err, "%s: %d %s" % (words, status, err))


WANTED = ("floor/memory/copy/all floor/disk/write-fsync engine/50k/domains whole/50k/wall whole/50k/cpu whole/50k/peak "
          "whole/50k/written whole/50k/first-triangle growth/20k/wall growth/50k/per-point second/100k/first-triangle "
          "corner/100k/share start/empty start/20-datasets").split()


def quick(folder):
    status, out, err = run("run", BUILD, "--quick", "--no-build", "--work", folder, "--keep", "--results", folder)
    expect(status == 0, "run --quick: %d\n%s%s" % (status, out, err))
    kept = re.search(r"^kept as (.*)$", out, re.M)
    expect(kept and open(kept[1]).read() in out, "the kept table is what was printed: %s" % out)
    names = [row.split()[0] for row in out.splitlines() if row and row[0] != "#" and not row.startswith("kept")]
    for name in WANTED:
        expect(name in names, "%s is missing:\n%s" % (name, out))
    # The right column is read: a phase that sorts 50,000 points takes a nanosecond a point at least.
    expect(re.search(r"^engine/50k/all +(0\.[0-9]+|[1-9]\S*) us/point", out, re.M)[1] > "0.05", out)
    expect(re.search(r"^# CPU .*memory \d+ GiB", out, re.M) and "# whole/50k: 1 domains, 99310 triangles" in out, out)
    status, out, err = run("compare", kept[1], kept[1])
    expect(status == 0 and "0 worse" in out, "a result with itself: %s%s" % (out, err))
    expect(os.listdir(folder) == [os.path.basename(kept[1])], "left behind: %s" % os.listdir(folder))


def large(folder):
    status, out, err = run("large", BUILD, "60k-32M", "--work", folder)
    expect(status == 0, "large: %d\n%s%s" % (status, out, err))
    for name in "generator-alone wall staging sealing planning domains-and-stream peak client-peak read written halo".split():
        expect(re.search(r"^large/60k-32M/%s " % name, out, re.M), "%s is missing:\n%s" % (name, out))
    expect(re.search(r"digest [0-9a-f]{32}, vertices [0-9a-f]{32}$", out, re.M), out)
    expect(os.listdir(folder) == [], "left behind: %s" % os.listdir(folder))


for test in (compare, refused, quick, large):
    with tempfile.TemporaryDirectory(prefix="acut-test-bench-") as base:
        test(base)
    print("ok  ", test.__name__, flush=True)
