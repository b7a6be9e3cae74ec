"""Watch a drill or a bag: live page in the browser, view in the terminal.

A server that cannot listen raises a ``ServerError``, a namespace that ROS does not permit a
``StartError``, and a bag that cannot be read a ``BagError``.
"""
