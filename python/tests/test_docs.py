"""The page of the package: its examples print what stands below them."""

import contextlib
import io
import pathlib
import re

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "python.md"
EXAMPLE = re.compile(r"```python\n((?:(?!```).)*)```\n```text\n(.*?)```", re.DOTALL)


def printed(page):
    """What each example prints, in one session."""
    names = {}
    for code, _ in EXAMPLE.findall(page):
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(code, str(PAGE), "exec"), names)
        yield out.getvalue()


def test_examples_print_what_the_page_says():
    page = PAGE.read_text(encoding="utf-8")
    expected = [text for _, text in EXAMPLE.findall(page)]
    assert len(expected) == 5
    assert list(printed(page)) == expected
