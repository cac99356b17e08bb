"""What a walk through the pages costs a person: clicks (taps) and keys, as the browser counts them."""

from __future__ import annotations

from typing import NamedTuple

from playwright.sync_api import BrowserContext, Page

# Letters of a word that is typed count as keys, one each.
_COUNTING = """for (const [kind, name] of [["click", "clicks"], ["keydown", "keys"]])
  addEventListener(kind, (event) => {
    if (event.isTrusted) sessionStorage[name] = 1 + Number(sessionStorage[name] ?? 0);
  }, true);"""


class Effort(NamedTuple):
    """Clicks and keys since a tab was opened."""

    clicks: int
    keys: int

    def minus(self, other: Effort) -> Effort:
        """What came since then."""
        return Effort(self.clicks - other.clicks, self.keys - other.keys)


def count_effort(context: BrowserContext) -> None:
    """Count on all pages that the context opens from now on."""
    context.add_init_script(_COUNTING)


def effort_of(page: Page) -> Effort:
    """The clicks and keys of a tab."""
    read = "['clicks', 'keys'].map((name) => Number(sessionStorage[name] ?? 0))"
    return Effort(*page.evaluate(read))
