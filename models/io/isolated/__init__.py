"""What reads files of unknown origin in a process of its own, which their libraries may crash or hang.

Each module has a function `read` for the path of a file, and imports one library; `io.untrusted` starts the process and
limits its time and memory. Nothing else may import these modules.
"""
