"""For tests that hold a table of the source against the lists that are written by hand: `wrong` has what differs."""
import os
import re
import sys

SOURCE = os.environ["ACUT_TEST_SOURCE"]
wrong = []


def read(name):
    with open(os.path.join(SOURCE, name), encoding="utf-8") as f:
        return f.read()


def find(what, pattern, text):
    """The first group; ends the test if the text has changed so much that it cannot be read."""
    found = re.search(pattern, text, re.S)
    if not found:
        sys.exit("%s is not where it was" % what)
    return found.group(1)


def compare(what, got, wanted):
    if got != wanted:
        wrong.append("%s: %s, but the table has %s" % (what, got, wanted))
