"""MATLAB and GNU Octave: a package folder with a file for each function."""
