"""Fail when a test was skipped for a reason that is not on the list, or when a report is missing or holds no test.

    python .ci/skips.py REPORT.xml...      (JUnit XML, as pytest writes it)

An expected failure counts as skipped: it hides as much. Nothing but the standard library is needed.
"""

import sys
import xml.etree.ElementTree as ElementTree

ALLOWED = ("third-party scenes are not beside this checkout",)


def skips(report: str) -> tuple[int, list[tuple[str, str]]]:
    """How many tests a report holds, and (test, reason) for each that was skipped or expected to fail."""
    cases = list(ElementTree.parse(report).getroot().iter("testcase"))
    skipped = [(case, case.find("skipped")) for case in cases if case.find("skipped") is not None]
    # a skip while collecting has its reason in the text, any other in the message
    return len(cases), [
        (f"{case.get('classname')}::{case.get('name')}", f"{mark.get('message') or ''} {mark.text or ''}".strip())
        for case, mark in skipped
    ]


def main(reports: list[str]) -> int:
    wrong, allowed, total = [], 0, 0
    for report in reports:
        try:
            count, skipped = skips(report)
        except (OSError, ElementTree.ParseError) as error:
            wrong.append(f"{report}: no readable test report ({error})")
            continue
        total += count
        if count == 0:
            wrong.append(f"{report}: no test ran")
        for test, reason in skipped:
            if any(known in reason for known in ALLOWED):
                allowed += 1
            else:
                wrong.append(f"{test}: skipped without leave: {reason or 'no reason'}")
    if not reports:
        wrong.append("no test report was named")
    for line in wrong:
        print(line, file=sys.stderr)
    print(f"skip guard: {total} tests, {allowed} skipped with leave, {len(wrong)} complaints")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
