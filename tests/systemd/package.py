"""The Debian packages: they build, lintian has no complaints, and in a container with a real systemd they are installed, used,
upgraded, removed and installed again without losing a dataset."""
import glob
import os
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "e2e"))
from e2e import expect, main, run, unavailable

for tool in ("dpkg-buildpackage", "dh", "dh_python3", "lintian", "po2debconf"):
    if not shutil.which(tool):
        unavailable(tool + " is not installed")
TOP = subprocess.run([os.path.join(HERE, "packages"), os.environ["BUILD"]], stdout=subprocess.PIPE, check=True, timeout=7200).stdout.decode().strip()


def all_are_there():
    names = sorted(os.path.basename(p).split("_")[0] for p in glob.glob(TOP + "/1/*.deb"))
    expect(names == ["acut", "acut-cluster", "acut-scanner", "libacut-dev", "libacut0", "python3-acut"], str(names))


def lintian_is_silent():
    changes, = glob.glob(TOP + "/1/*.changes")
    got = run(["lintian", "--allow-root", "--fail-on", "error,warning", changes], timeout=1800)
    expect(got.status == 0 and not got.out.strip(), got.out + got.err)


def in_a_container():
    args = [os.path.join(HERE, "run"), "--tree", "none", "--time", "1800", "--bind", TOP + ":/opt/acut/packages",
            os.path.join(HERE, "package_inside")]
    r = subprocess.run(args, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=7200)
    text = r.stdout.decode(errors="replace")
    print("".join("     " + line + "\n" for line in text.splitlines()))
    if r.returncode == 77:
        unavailable(text.strip())
    expect(r.returncode == 0, "status %d" % r.returncode)


main(all_are_there, lintian_is_silent, in_a_container)
