"""The ROS 2 face: node, parameters, conversions, recorder and replayer.

A value that cannot be used is a ``ParameterError``, and a node or a name that ROS does not permit
a ``StartError``. A request to a thread that has ended is a ``StoppedError``, and one that is
refused a ``RefusedError`` with the reason.
"""
