"""``python -m tests.blind.score --bank BANK --results RESULTS``: how well the hidden was found.

Reads ``discovery.json`` of each case and its label; prints the table of what must be reached, the confusion
matrix and the power of each kind. Cases that were not run yet do not count, and their number is told.
Runs of many hours can be put together: with ``--records`` every case is kept in one line of a table.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

from tests.blind.make import UNMET
from tests.blind.scoring.outcomes import outcomes
from tests.blind.scoring.records import joined, read_records, write_records
from tests.blind.scoring.tables import TABLES, markdown, remarks, text


def main(arguments: list[str] | None = None) -> int:
    """Print the tables; with ``--out`` write them as Markdown, too."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.score", description=__doc__)
    parser.add_argument("--bank", type=Path, required=True)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--records", type=Path, help="table of cases that were run before; these are added")
    parser.add_argument("--out", type=Path, help="Markdown file to write")
    given = parser.parse_args(arguments)
    found = [o.record for o in outcomes(given.bank, given.results)]
    if given.records:
        found = joined(read_records(given.records), found)
        write_records(found, given.records)
    bank = {label.stem for label in (given.bank / "labels").glob("*.json")}
    here = sum(record.id in bank for record in found)
    head = f"{here} of {len(bank)} cases were run{_besides(len(found) - here)}."
    if not found:
        sys.stdout.write(head + "\n")
        return 1
    made = {title: table(found) for title, table in TABLES.items()}
    tables = {title: rows for title, rows in made.items() if len(rows) > 1}
    notes = "\n".join([*remarks(found), *_list_unmet(given.bank)])
    screen = "\n\n".join(f"{title}\n{text(rows)}" for title, rows in tables.items())
    sys.stdout.write(f"{head}\n\n{screen}\n\n{notes}\n")
    if given.out:
        page = "\n\n".join(f"## {title}\n\n{markdown(rows)}" for title, rows in tables.items())
        given.out.write_text(f"# The blind bank\n\n{head}\n\n{page}\n\n{notes}\n", encoding="utf-8")
    return 0


def _list_unmet(bank: Path) -> list[str]:
    """Which cases were not made, in a sentence."""
    kinds = (json.loads(file.read_text(encoding="utf-8"))[0] for file in (bank / UNMET).glob("*.json"))
    found = ", ".join(f"{kind} {n}" for kind, n in sorted(Counter(kinds).items()))
    return [f"Not made, for nobody meets twice what their recordings can name: {found}."] if found else []


def _besides(others: int) -> str:
    return f", and {others} of other banks" if others else ""


if __name__ == "__main__":
    raise SystemExit(main())
