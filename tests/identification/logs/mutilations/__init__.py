"""Kinds of mutilation of a healthy log, by what is mutilated."""
