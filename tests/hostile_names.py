"""Names of objects and units that mean something to a figure, a page, a terminal or a format."""

NAMES = [
    r"$\frac{1}{0$ _^",
    "<script>document.title='taken'</script>",
    "_quo\"te's` **x** [a](#b) </td></table>",
    "\N{GRINNING FACE} \N{HEBREW LETTER ALEF}\N{HEBREW LETTER BET} \N{RIGHT-TO-LEFT OVERRIDE}turned",
    "long na\N{THUMBS UP SIGN}me " * 1000,
    "esc\x1b[31m\r\n\ttab [bold]{0}%s",
]
UNIT = "mm $x_{$ <b>\x1b[31m"
