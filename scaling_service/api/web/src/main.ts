document.body.append("scaling-service");
