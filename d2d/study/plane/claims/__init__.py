"""The claims on scenes in the plane, a module for each kind of scene."""
