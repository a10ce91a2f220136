"""Whose marker is it: labels of a recording and the segments and landmarks that they stand for, by geometry.

A marker is where it sits and what it moves with; its name is one piece of evidence.
"""
