"""When, why and by how much time multiplexing helps: designed and random codes over noise, full well and slots."""
