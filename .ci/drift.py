"""Compares two scores.csv: the same rows and columns, the same texts, numbers within 1e-6.

usage: drift.py COMMITTED FOUND
"""

import csv
import sys

TOLERANCE = 1e-6


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    return {(row["pair_id"], row["method"]): row for row in table}


def differs(committed, found):
    """How far apart two fields are: None if they agree, else a text."""
    if committed == found:
        return None
    try:
        difference = abs(float(committed) - float(found))
    except ValueError:
        return "differs"
    return None if difference <= TOLERANCE else f"off by {difference:.3e}"


def main():
    committed, found = (rows(path) for path in sys.argv[1:3])
    problems = [f"{key}: only in one of the two" for key in sorted(committed.keys() ^ found.keys())]
    for key in sorted(committed.keys() & found.keys()):
        a, b = committed[key], found[key]
        for column in sorted(a.keys() | b.keys()):
            reason = differs(a.get(column, ""), b.get(column, ""))
            if reason:
                problems.append(f"{key} {column}: {a.get(column)} and {b.get(column)}, {reason}")
    for problem in problems[:20]:
        print(problem)
    if problems or not committed:
        sys.exit(f"{len(problems)} differences in {len(committed)} rows")
    print(f"{len(committed)} rows agree with {sys.argv[1]} to {TOLERANCE:g}")


if __name__ == "__main__":
    main()
