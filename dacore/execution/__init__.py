"""The same work for many items, in this process, in processes beside it, or on a cluster."""
