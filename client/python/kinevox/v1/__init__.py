"""The daemon's messages as protoc makes them of proto/kinevox/v1; made while building, none are in the repository."""
