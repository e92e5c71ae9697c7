"""More segments than one rewrite takes meet in one range: by their number, and by the memory of a task. They are rewritten in groups,
and the dataset has the same records and sources as an unsorted one."""
import os
import random
import subprocess
import tempfile

RUN, DUMP = os.environ["ACUT_SURVEY_RUN"], os.environ["ACUT_GRID_DUMP"]


def inputs(folder, n, points):
    """Texts of points all over one place, so that every segment meets every range."""
    rng = random.Random(5)
    names = []
    for i in range(n):
        names.append(os.path.join(folder, "in%d.xyz" % i))
        with open(names[-1], "w") as f:
            for _ in range(points):
                f.write("%.2f %.2f %.2f\n" % (rng.uniform(1000, 2000), rng.uniform(1000, 2000), rng.uniform(0, 9)))
    return names


def records(folder, name, files, stages, sorts, memory):
    work = os.path.join(folder, name)
    r = subprocess.run([RUN, work, str(stages), memory, "sorts=%d" % sorts, "unit_xy=metre", "unit_z=metre"],
                       input="".join(p + "\n" for p in files), text=True, capture_output=True)
    assert r.returncode == 0, r.stderr
    r = subprocess.run([DUMP, "--check", "--records", os.path.join(work, "dataset", "manifest")], capture_output=True, text=True)
    assert r.returncode == 0, r.stderr
    left = [n for n in os.listdir(work) if n.startswith("group")]
    assert not left, left
    lines = r.stdout.splitlines()
    segments = sum(line.startswith("  segment ") for line in lines)
    groups = 0
    for i in range(sorts):
        with open(os.path.join(work, "done", "sort-%d" % i)) as f:
            groups += sum(line.startswith("value groups ") and int(line.split()[2]) for line in f)
    return segments, sorted(line for line in lines if line.startswith("      ")), groups


def main():
    memory = "/dev/shm"  # two thousand tasks sync their files
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else None) as folder:
        files = inputs(folder, 600, 12)
        n, unsorted, _ = records(folder, "unsorted", files, 600, 0, "256M")
        assert n == 600 and len(unsorted) == 7200, (n, len(unsorted))
        n, got, groups = records(folder, "sorted", files, 600, 1, "256M")
        assert n == 1 and got == unsorted, (n, len(got))
        assert groups == 2, groups
        _, unsorted, _ = records(folder, "fewer", files[:500], 500, 0, "32M")
        n, got, groups = records(folder, "small", files[:500], 500, 1, "32M")
        assert n == 1 and len(got) == 6000 and got == unsorted, (n, len(got))
        assert groups > 1, groups


main()
