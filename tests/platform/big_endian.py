"""A big-endian machine is refused when acut is configured, by name, and not by one of the assertions that its rooms have."""
import os
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
with tempfile.TemporaryDirectory() as to:
    p = subprocess.run(["meson", "setup", to, os.path.join(HERE, "..", ".."), "--cross-file", os.path.join(HERE, "s390x.ini")],
                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
said = [line for line in p.stdout.splitlines() if "ERROR" in line]
if not p.returncode or len(said) != 1 or "big-endian machines (s390x)" not in said[0]:
    sys.exit("a big-endian machine: status %d\n%s" % (p.returncode, p.stdout))
