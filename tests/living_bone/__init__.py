"""Skin markers over bones whose true pose was measured (Cereatti et al. 2017)."""
