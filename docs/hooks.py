"""For mkdocs: links of the older pages to files of the repository outside docs/ become their names, which is what a
reader of the site can do with them."""

import re


def on_page_markdown(markdown, page, **_):
    """Called by mkdocs with the text of each page."""
    if "/" in page.file.src_uri:
        return markdown
    return re.sub(r"\[([^\]]+)\]\(\.\./([^)]+)\)", r"\1 (`\2`)", markdown)
