"""The user's guide: Markdown pages, shown on a terminal, by the service and from a folder of files."""
