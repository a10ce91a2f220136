"""The service over HTTP: it takes requests apart, asks ``jobs.service``, and puts answers together.

Nothing here computes or waits in the event loop: the store is asked in threads, jobs run in the runner's
processes. ``app`` is all of it as one ASGI application, ``serving`` the server that runs it; routes are in
``subjects``, ``laboratory``, ``jobs``, ``contents``, ``monitoring``, ``documentation`` and ``site``.
"""
