"""The functional tests under the sandbox of the shipped unit (in a container): sandbox.py SCRIPT... runs these scripts of
tests/e2e. Their daemons are units with seccomp, where a forbidden system call kills. Without names: the scripts that take a few
seconds."""
import os
import re
import subprocess
import sys
import time

E2E = "/opt/acut/tree/tests/e2e"
SCRIPTS = ["commands", "pipes", "text"]
UNIT = "/usr/local/lib/systemd/system/acutd.service"

names = sys.argv[1:] or SCRIPTS
failed, cases = 0, 0
env = dict(os.environ, ACUT_UNIT_DAEMON=UNIT)
for name in names:
    start = time.monotonic()
    p = subprocess.run(["/usr/bin/python3", "%s/%s.py" % (E2E, name)], env=env, cwd=E2E, stdin=subprocess.DEVNULL,
                       stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=1800)
    out = p.stdout.decode(errors="replace")
    passed = len(re.findall(r"^ok ", out, re.M))
    cases += passed
    failed += p.returncode != 0 or not passed
    print("%-4s %-12s %2d cases %6.1f s" % ("FAIL" if p.returncode or not passed else "ok", name, passed, time.monotonic() - start), flush=True)
    if p.returncode or not passed:
        print(out, flush=True)
journal = subprocess.run(["journalctl", "--no-pager", "-o", "cat", "_PID=1"], stdout=subprocess.PIPE).stdout.decode(errors="replace")
daemons = len(re.findall(r"^Started acutd-test-", journal, re.M))
killed = [line for line in journal.split("\n") if "status=31/SYS" in line]
print("%d cases of %d scripts, %d daemons under seccomp, %d killed for a call" % (cases, len(names), daemons, len(killed)))
sys.exit(1 if failed or killed or not daemons else 0)
