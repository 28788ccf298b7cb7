"""Numba loops at module level (so that numba's cache finds them); the rooms above wrap and explain them."""
