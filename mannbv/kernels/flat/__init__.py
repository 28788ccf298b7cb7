"""Flatland: a row of pixels, segments that rays meet."""
