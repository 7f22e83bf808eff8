"""Small photographs in every common pixel format, by Pillow 11.3.0.

Each shows four quadrants of 16x16 pixels: red, green / blue, a mid grey (see QUADRANTS; `grey*` their luma).
Usage: python3 make.py FOLDER
"""

import sys
from pathlib import Path

from PIL import Image

QUADRANTS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (128, 128, 128)]
LUMA = [76, 150, 29, 128]  # Pillow's convert("L")


def paint(mode, colours):
    image = Image.new(mode, (32, 32))
    for k, colour in enumerate(colours):
        x, y = 16 * (k % 2), 16 * (k // 2)
        image.paste(colour, (x, y, x + 16, y + 16))
    return image


def main(out):
    rgb = paint("RGB", QUADRANTS)
    rgb.quantize(8, dither=Image.Dither.NONE).save(out / "palette.png")
    # One palette entry fully transparent: its colour still counts.
    rgb.quantize(8, dither=Image.Dither.NONE).save(out / "palette_transparent.png", transparency=0)
    rgb.convert("1", dither=Image.Dither.NONE).save(out / "bilevel.png")
    paint("L", LUMA).save(out / "grey.png")
    paint("LA", [(v, 60) for v in LUMA]).save(out / "grey_alpha.png")
    paint("RGBA", [(*c, 60) for c in QUADRANTS]).save(out / "rgba.png")
    paint("I;16", [257 * v for v in LUMA]).save(out / "grey16.png")
    paint("L", LUMA).save(out / "grey.jpg", quality=95)
    # Cyan, magenta, yellow, black; Pillow writes Adobe's marker and inverted values, as Photoshop does.
    cmyk = [(0, 255, 255, 0), (255, 0, 255, 0), (255, 255, 0, 0), (0, 0, 0, 127)]
    paint("CMYK", cmyk).save(out / "cmyk.jpg", quality=95)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
