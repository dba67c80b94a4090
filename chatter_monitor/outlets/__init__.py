"""Where results go: sockets, files, terminals."""
