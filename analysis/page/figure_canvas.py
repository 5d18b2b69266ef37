"""SVG of a figure: measured and drawn by one renderer, with texts that are laid out once for all figures."""

from io import StringIO
from typing import IO, Any

from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.textpath import TextToPath


def _face(prop: FontProperties) -> tuple[Any, ...]:
    """A font without its size."""
    more = prop.get_stretch(), prop.get_file(), prop.get_math_fontfamily()
    return *prop.get_family(), prop.get_style(), prop.get_variant(), prop.get_weight(), *more


class _Texts(TextToPath):
    """Remembers the sizes and glyphs of texts, which takes as long as all else to find."""

    def __init__(self) -> None:
        super().__init__()
        self._sizes: dict[tuple[Any, ...], tuple[float, float, float]] = {}
        self._heights: dict[tuple[Any, ...], tuple[float, float, float, float] | None] = {}
        self._laid: dict[tuple[Any, ...], list[Any]] = {}
        self._shapes: dict[str, Any] = {}

    def get_text_width_height_descent(self, s: str, prop: FontProperties, ismath: Any) -> tuple[float, float, float]:
        key = s, ismath, *_face(prop)
        if key not in self._sizes:
            whole = prop.copy()
            whole.set_size(self.FONT_SCALE)
            self._sizes[key] = super().get_text_width_height_descent(s, whole, ismath)
        width, height, descent = self._sizes[key]
        scale = prop.get_size_in_points() / self.FONT_SCALE
        return width * scale, height * scale, descent * scale

    def heights(self, prop: FontProperties) -> tuple[float | None, float | None, float | None]:
        """Ascent, descent and gap of lines, as `Text` finds them in the font."""
        face = _face(prop)
        if face not in self._heights:
            font: Any = get_font(findfont(prop))
            lines, units = font.get_sfnt_table("OS/2"), font.get_sfnt_table("head")["unitsPerEm"]
            names = "sTypoAscender", "sTypoDescender", "sTypoLineGap"
            self._heights[face] = None if lines is None else (units, *(lines[name] for name in names))
        known = self._heights[face]
        if known is None:
            return None, None, None
        units, ascent, descent, gap = known
        scale = 1 / units * prop.get_size_in_points()
        return ascent * scale, -descent * scale, gap * scale

    def get_glyphs_with_font(
        self, font: Any, s: str, glyph_map: Any = None, return_new_glyphs_only: bool = False, **options: Any
    ) -> tuple[list[Any], Any, list[Any]]:
        key = font, s, *options.items()
        if key not in self._laid:
            self._laid[key], new, _ = super().get_glyphs_with_font(font, s, self._shapes, True, **options)
            self._shapes.update(new)
        laid, known = self._laid[key], {} if glyph_map is None else glyph_map
        new = {name: self._shapes[name] for name, *_ in laid if name not in known}
        return laid, new if return_new_glyphs_only else {**known, **new}, []


_TEXTS = _Texts()


class _Renderer(RendererSVG):
    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._text2path = _TEXTS

    def _get_font_height_metrics(self, prop: FontProperties) -> tuple[float | None, float | None, float | None]:
        return _TEXTS.heights(prop)


class Canvas(FigureCanvasSVG):
    """What `Figure.savefig` draws on, once, after the figure was laid out on it."""

    def __init__(self, figure: Figure, dpi: float, metadata: dict[str, Any]) -> None:
        super().__init__(figure)
        self._written = StringIO()
        figure.dpi = 72
        width, height = figure.get_size_inches()
        vector = _Renderer(72 * width, 72 * height, self._written, image_dpi=dpi, metadata=metadata)
        self._renderer: Any = MixedModeRenderer(figure, width, height, dpi, vector)

    def get_renderer(self) -> Any:
        """What measures texts."""
        return self._renderer

    def print_svg(self, filename: IO[bytes], **_: Any) -> None:
        """Draws the figure into a file."""
        self.figure.dpi = 72
        self.figure.draw(self._renderer)
        self._renderer.finalize()
        filename.write(self._written.getvalue().encode())
