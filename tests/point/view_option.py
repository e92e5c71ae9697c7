"""The words of views (base/view_option.def) and the rules (engine/point/view.c) against what is written by hand: protocol.md, the Python
module, the dictionary of the fuzzer, the manual of acut-verify. acutctl(1) is compared with the options by tests/acutctl/cli.py."""
import ast
import os
import re
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from tables import compare, find, read, wrong


rows = re.findall(r'^VIEW_(FLAG|COUNT|HEIGHT|OWN)\(\w+, "([^"=]+)=?"', read("base/view_option.def"), re.M)
words = [word for _, word in rows]
if len(rows) < 10:
    sys.exit("the table cannot be read: %s" % rows)

views = find("Views", r"\n### Views\n(.*?)\n### ", read("docs/formats/protocol.md"))
listed = re.findall(r"`([a-z-]+)(?:=[^`]*)?`", find("the words", r"in this order: (.*?)`view 1` alone", views))
picks = {"lowest", "highest", "median"}
compare("protocol.md, the canonical text", [w for w in dict.fromkeys(listed) if w not in picks], words)

rules = re.findall(r'\[VIEW_(?:BY_\w+)\] = "([^"]+)"', read("engine/point/view.c"))
if len(rules) < 10:
    sys.exit("the rules cannot be read: %s" % rules)
compare("protocol.md, the rules", sorted(re.findall(r"`([a-z-]+)`", find("the rules", r"Rules apply in the order (.*?)\.", views))), sorted(rules))

text = read("python/acut/_view.py")
function = next(f for f in ast.walk(ast.parse(text)) if isinstance(f, ast.FunctionDef) and f.name == "view_text")
given, doc = [a.arg for a in function.args.kwonlyargs], ast.get_docstring(function)
compare("view_text of Python", sorted(set(given) - {"class_", "surface", "thin_pick", "bbox", "polygon"}),
        sorted(w.replace("-", "_") for w in words if w not in ("class", "window")))
for name in given:
    if not re.search(r"\b%s\b" % name, doc):
        wrong.append("view_text of Python: %s is not in its docstring" % name)

dictionary = re.findall(r'^" ([a-z-]+)', read("tests/fuzz/view.dict"), re.M)
compare("tests/fuzz/view.dict", sorted(set(dictionary)), sorted(words))

page = read("man/acut-verify.1.scd")
for kind, word in rows:
    if kind == "FLAG" and "*--%s*" % word not in page:
        wrong.append("acut-verify(1): no --%s" % word)

print("\n".join(wrong) or "%d words, %d rules" % (len(words), len(rules)))
sys.exit(1 if wrong else 0)
