/* Leaflet.Editable 1.3.2, https://github.com/Leaflet/Leaflet.Editable
 * Copyright (c) Yohan Boniface. Licence: WTFPL, version 2: "You just DO WHAT THE FUCK YOU WANT TO." */
