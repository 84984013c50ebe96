"""What has to hold, told line by line; a test goes on after one that does not."""
failures = []


def check(holds, rule, found=""):
    print(("holds   " if holds else "FAILS   ") + rule + ("" if holds else f": {found}"))
    if not holds:
        failures.append(rule)
