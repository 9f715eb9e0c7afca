"""What a verdict says in one sentence, for pages, card and command alike; none says more than its test does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

VERDICTS: Mapping[str, str] = {
    # p above .05 is no proof of nothing: what is smaller than a limit may be there.
    "no_misfit": "Consistent with the model: nothing larger than the limits of these data was detected.",
    "named": "The data are consistent with one cause of the library.",
    "named_with_remainder": "A cause of the library explains part of the misfit; something is left.",
    "ambiguous": "Something is wrong, and these data do not tell which of several causes it is.",
    "unexplained": "Something is wrong that no cause of the library explains.",
    "refused": "No diagnosis: the data or the emulators do not carry one.",
}
# A verdict is ambiguous too where one cause holds nearly all of the library's probability, but not at every scale
# of the prior, or against the runs without an effect.
ONE_LIKELY = (
    "Something is wrong and one cause is the likeliest, but it is not named: how likely it is depends on how large"
    " one assumes such effects to be, or chance is not excluded well enough."
)


def verdict_sentence(verdict: str, result: Mapping[str, Any] | None) -> str:
    """Of a published result. Raises KeyError for a verdict that there is not."""
    return ONE_LIKELY if is_one_likely(verdict, result) else VERDICTS[verdict]


def is_one_likely(verdict: str | None, result: Mapping[str, Any] | None) -> bool:
    """Whether an ambiguous result knows of one effect only."""
    return verdict == "ambiguous" and len((result or {}).get("also_possible", ())) == 1
