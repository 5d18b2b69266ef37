"""Version of the kit, apart from that of the package; CHANGELOG.md beside this file says what each one changed."""

KIT_VERSION = "1.0.0"
RELEASED = "2026-11-27"
