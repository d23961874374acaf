"""A page measured in millimetres, its colours and its type."""
import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

WIDTH_MM, HEIGHT_MM, MARGIN_MM = 210, 297, 14
INNER_MM = WIDTH_MM - 2 * MARGIN_MM

INK, SOFT, FAINT, RULE, PAPER = "#1b2430", "#5b6675", "#93a0b0", "#d9dfe6", "#ffffff"
PANEL = "#f4f6f8"
LEFT, RIGHT, MIDDLE = "#0072b2", "#d55e00", "#3f4a58"  # blue and orange: distinct for colour-blind readers
STAGE_COLOURS = {
    "segmentation": "#3b6ea5",
    "tracking": "#7aa6c2",
    "hull": "#4f9d8b",
    "colouring": "#a7c58b",
    "pose": "#d9a441",
}

pyplot.rcParams.update(
    {
        "font.family": "DejaVu Sans",
        "text.color": INK,
        "axes.edgecolor": RULE,
        "axes.labelcolor": SOFT,
        "axes.linewidth": 0.6,
        "xtick.color": SOFT,
        "ytick.color": SOFT,
        "xtick.labelsize": 6.5,
        "ytick.labelsize": 6.5,
        "xtick.major.size": 2,
        "ytick.major.size": 0,
        "xtick.major.width": 0.6,
        "pdf.fonttype": 42,
        "svg.hashsalt": "kinevox",
        "path.simplify": False,
    }
)


class Sheet:
    """Positions in mm from the top left corner."""

    def __init__(self):
        self.figure = pyplot.figure(figsize=(WIDTH_MM / 25.4, HEIGHT_MM / 25.4), facecolor=PAPER)

    def axes(self, x, y, width, height):
        return self.figure.add_axes([x / WIDTH_MM, 1 - (y + height) / HEIGHT_MM, width / WIDTH_MM, height / HEIGHT_MM])

    def drawing(self, x, y, width, height):
        """Axes without frame whose units are mm from their own top left corner."""
        axes = self.axes(x, y, width, height)
        axes.set_axis_off()
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        return axes

    def text(self, x, y, words, **style):
        style = {"size": 8, "va": "baseline", "parse_math": False, **style}  # a name may contain dollar signs
        return self.figure.text(x / WIDTH_MM, 1 - y / HEIGHT_MM, words, **style)

    def heading(self, x, y, words, width, note=""):
        """A section's title over a rule."""
        self.text(x, y, words, size=9, weight="bold")
        if note:
            self.text(x + width, y, note, size=6.5, color=SOFT, ha="right")
        self.line(x, y + 1.8, width)

    def line(self, x, y, width, colour=RULE, thickness=0.6):
        self.figure.add_artist(
            matplotlib.lines.Line2D(
                [x / WIDTH_MM, (x + width) / WIDTH_MM], [1 - y / HEIGHT_MM] * 2, color=colour, linewidth=thickness
            )
        )

    def side_legend(self, x, y):
        """Which colour is which side; right-aligned at x."""
        self.text(x - 15.5, y, "left", size=7, color=LEFT, ha="right", weight="bold")
        self.text(x, y, "right", size=7, color=RIGHT, ha="right", weight="bold")
        for at, colour in ((x - 25.5, LEFT), (x - 12, RIGHT)):
            self.line(at, y - 0.9, 3.2, colour, 1.6)

    def save(self, out, kind):
        # No date inside: the same trial gives the same file.
        metadata = {"png": {"Software": "kinevox report"}, "pdf": {"Creator": "kinevox report", "CreationDate": None}}
        self.figure.savefig(out, format=kind, dpi=200, metadata=metadata[kind])
        pyplot.close(self.figure)
