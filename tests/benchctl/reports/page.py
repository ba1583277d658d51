"""A page taken apart by the standard library's parser."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = {"meta", "br", "hr", "img", "link", "input"}


class Page(HTMLParser):
    """Balanced tags (or an assertion fails), their attributes, the text, the numbers of `data` elements."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.text: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text.append(data)

    @property
    def words(self) -> str:
        """The text with single spaces."""
        return " ".join(" ".join(self.text).split())

    @property
    def numbers(self) -> list[float]:
        """The unrounded numbers behind those that are shown."""
        return [float(attrs["value"] or "") for tag, attrs in self.tags if tag == "data"]

    @property
    def ids(self) -> list[str]:
        """All ids, repeated ones too."""
        return [attrs["id"] or "" for _, attrs in self.tags if "id" in attrs]

    @property
    def figures(self) -> list[dict[str, str | None]]:
        """Attributes of the elements that hold a figure."""
        return [attrs for _, attrs in self.tags if attrs.get("role") == "img"]

    def refers_elsewhere(self) -> list[str]:
        """What a browser would fetch."""
        fetched = [tag for tag, _ in self.tags if tag in ("script", "link", "img", "iframe", "object")]
        targets = [attrs.get(name) or "#" for _, attrs in self.tags for name in ("src", "href")]
        return fetched + [target for target in targets if not target.startswith(("#", "data:"))]
