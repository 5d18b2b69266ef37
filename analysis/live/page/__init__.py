"""Page of the live view: HTML, CSS and JavaScript without a build step and without anything from the network.

Start at player.js; `assets` serves the files or joins them into one. No Python comes in.
"""
