"""Words and phrases that must not occur in texts, each with a plain one that replaces it.

``check_repository.py`` looks for them in pages, help, comments of messages, docstrings, comments
and texts of errors.
"""

EVERYWHERE = {
    r"shall": "must",
    r"in place of": "instead of",
    r"called so": "named",
    r"go(?:es|ing)? on|went on": "continue",
    r"in force": "active",
    r"at once": "immediately, together",
    r"says? so": "reports it",
    r"says?|said|tells?|told|hears?(?!:)|heard": "report, contain, show, receive",
    r"stands? still|stood still|stands?|stood": "is paused, is stopped, means, is",
    r"(?<!there )(?<!There )(?:is|are|was) no (?!longer|more|such)\w+": "is not a",
    r"nothing of": "no part of",
    r"refus(?:e|es|ed|ing|al|als)": "reject",
    r"torn": "truncated",
    r"made safe": "ramped to zero",
    r"gives? way|giving way": "yields",
    r"strangers?": "third party",
    r"owed|owes": "pending",
    r"flights?|flown": "run, free motion",
    r"the present": "the current",
    r"that of|those of": "the noun again",
}
"""By pattern, in all texts."""

PAGES = {
    r"figures? (?!of a)": "metric, picture",
    r"rooms?": "package, space",
    r"as of": "as in, since",
    r"moments?(?! of inertia)": "time",
}
"""By pattern, in pages, help and comments of messages only."""
